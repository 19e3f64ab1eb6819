# Everything a new machine needs: Python 3.11, make, git. `make demo` and `make test` work from nothing.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
# Tests wait for clocks of the host half of their time: three at a time keep two processors busy.
JOBS   ?= 3
# One thread a process: two torch or BLAS threads on a busy two-core machine are up to 100 times slower than one.
export OMP_NUM_THREADS := 1
export MKL_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MPLBACKEND := Agg
# Set in many containers: every process would then compile its imports anew (scipy and pandas: 2 s, torch: 4 s).
export PYTHONDONTWRITEBYTECODE :=
# uv reads its own variable for local wheel folders, not pip's.
export UV_FIND_LINKS ?= $(PIP_FIND_LINKS)

.PHONY: setup first-hour site pins demo test lint audit licences coverage repeats reliability mutants bench bench-gpu fuzz clean
setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv==0.13.8
	$(BIN)/uv pip install --quiet --python $(BIN)/python --constraint constraints.txt --editable '.[test,lint,bench]'
	touch $(STAMP)

demo: $(STAMP)
	rm -rf demo-out
	$(BIN)/gyrobench campaign rehearse examples/cold_shock_campaign.toml --bench examples/demo.toml --out demo-out

test: $(STAMP) lint
	$(BIN)/pytest -n $(JOBS)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Known vulnerabilities of the pins; says aloud what the package index could not answer.
audit: $(STAMP)
	$(BIN)/python -m benchmarks.audit

# What every pin says of its licence, into docs/licences.md; fails if a bench computer needs the GPL.
licences: $(STAMP)
	$(BIN)/python -m benchmarks.licences --write

# Everything that README and guide tell a newcomer to type, from `make setup` on in a fresh copy: ten minutes and more.
first-hour: $(STAMP)
	$(BIN)/python -m benchmarks.first_hour

# The pins of what a bench computer runs, with hashes: constraints.txt without torch, which has another build on every index.
pins: $(STAMP)
	$(BIN)/uv pip compile --quiet pyproject.toml --constraint constraints.txt --python-version 3.11.7 --generate-hashes \
		--no-annotate --no-header --extra analysis --extra exchange --extra panel --extra postgres --extra scale --extra sign --extra bluesky --extra visa \
		--output-file deploy/requirements.txt

# The documentation as a site, in site/index.html; no network is asked.
site: $(STAMP)
	$(BIN)/python -m benchmarks.site site

# Branch coverage of the rooms, their subprocesses included; slow: every test runs under the tracer. One process:
# a pytest-xdist worker that takes more than 10 s to save its data is killed, and its half of the tests is lost.
coverage: $(STAMP)
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest
	$(BIN)/coverage combine -q
	$(BIN)/coverage report --skip-covered --sort=cover
	$(BIN)/python -m benchmarks.rooms

# The tests marked concurrent, TIMES times (200); those that are slow too a tenth as often.
repeats: $(STAMP)
	$(BIN)/python -m benchmarks.repeats $(TIMES)

# Guards, kills, faults, time to the safe state: for a nightly machine; benchmarks/reliability.md.
reliability: $(STAMP)
	$(BIN)/python -m benchmarks.guards
	$(BIN)/python -m benchmarks.reliability 300 1
	$(BIN)/python -m benchmarks.command_kills 120 1
	$(BIN)/python -m benchmarks.tap 500 1
	$(BIN)/python -m benchmarks.failed_calls 200 1
	$(BIN)/python -m benchmarks.tamper 1000 1
	$(BIN)/python -m benchmarks.soak 300 1
	$(BIN)/python -m benchmarks.week
	$(BIN)/python -m benchmarks.abort_latency 25

# What share of random changes to the code the related tests catch: SAMPLE mutants (200) in each room, or in ROOM; DRAW=2: others.
mutants: $(STAMP)
	$(BIN)/python -m benchmarks.mutants $(or $(SAMPLE),200) $(ROOM) --draw $(or $(DRAW),1)

# Every benchmark against its peer and limit, written to benchmarks/RESULTS.md; QUICK=--quick is less precise.
bench: $(STAMP)
	$(BIN)/python -m benchmarks --write $(QUICK)

# LSTM training and gap fits on a CUDA device against the processor; says so where torch sees none.
bench-gpu: $(STAMP)
	$(BIN)/python -m benchmarks.gpu

fuzz: $(STAMP)
	$(BIN)/python -m benchmarks.fuzz $(BYTES)

clean:
	rm -rf $(VENV) demo-out site build .pytest_cache .mypy_cache .ruff_cache .hypothesis
