"""An outside judge: a tap between lab and bench that shares no code with the project, and trials it judges."""
