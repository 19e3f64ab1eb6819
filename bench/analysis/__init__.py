"""What is worked out from runs: figures, compensations, the gap between simulation and bench."""
