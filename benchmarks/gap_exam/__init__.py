"""The gap diagnosis examined on plant families of different physics, each case a folder of recordings and a
seal.

    python -m benchmarks.gap_exam make ring_laser --seed 1 --cases 36 --out DIR
    python -m benchmarks.gap_exam diagnose DIR --jobs 2
    python -m benchmarks.gap_exam score DIR [DIR ...] [--write]

DIR/cases/NAME has what a diagnosis may see: logs, `runs.toml`, `held_out.txt` (ids of runs that judge).
DIR/sealed has NAME.json (kind, effects with their signal-to-noise ratio, true values) and NAME.npz (each
effect in each run, means of 1 s, deg/h; key `effect|CODE|k` for the run in file `CODE_{k+1}`).
DIR/nominal.toml is the model to start from. Whoever writes such a folder is examined by the same commands.
"""
