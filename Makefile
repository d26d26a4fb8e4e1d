# Every target sets itself up: `make study` and `make test` work on a fresh clone.
SHELL := /bin/bash
VENV  := .venv
BIN   := $(VENV)/bin
READY := $(VENV)/.ready
WORKERS ?= 2

# One thread a test worker: the workers themselves use the cores.
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 \
	XLA_FLAGS="--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

.PHONY: study test lint bench validate reports fuzz mutation lowest newest scheduled audit coverage docs lock clean
.DEFAULT_GOAL := study

study: $(READY)
	$(BIN)/bayesdamp study studies/quickstart.toml

test: $(READY)
	$(ONE_THREAD) $(BIN)/python -m pytest -n $(WORKERS) -m "not slow" $(ARGS)

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

# Writes reports/benchmarks, with the ratios of the run before.
bench: $(READY)
	$(ONE_THREAD) $(BIN)/python -m pytest tests/benchmarks --override-ini addopts= -s -p no:xdist $(ARGS)

# The slow checks, which `make test` leaves out, and which answers on 236 fixed records have changed.
validate: $(READY)
	$(ONE_THREAD) $(BIN)/python -m pytest -n $(WORKERS) -m slow $(ARGS)
	$(ONE_THREAD) $(BIN)/python -m validation.frozen compare

# The shipped reports whose sources have changed, the cheap ones first; an hour and a quarter, and resumes. ARGS=--check says
# which.
reports: $(READY)
	$(ONE_THREAD) $(BIN)/python -m validation.reports $(ARGS)

# Damaged files, studies and command lines, other ones each time; about an hour. A finding is printed with its cause.
EXAMPLES ?= 2000
fuzz: $(READY)
	FUZZ_EXAMPLES=$(EXAMPLES) $(ONE_THREAD) $(BIN)/python -m pytest -n $(WORKERS) tests/fuzz $(ARGS)

# A wrong operator, number or condition put into a copy, a hundred times: do the tests notice?
mutation: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt "cosmic-ray>=8.3"
	$(ONE_THREAD) $(BIN)/python -m validation.mutation $(ARGS)

# The lowest versions that pyproject.toml allows, in an environment of their own: does a quick part of the tests pass?
# What they call deprecated in each other is no fault of ours there.
LOW   := .lowest
PARTS ?= tests/physics tests/verdict tests/store tests/records/readers tests/config
lowest: $(READY)
	$(BIN)/python -m venv $(LOW)
	$(LOW)/bin/python -m pip install --quiet --disable-pip-version-check uv
	$(LOW)/bin/uv pip compile --quiet --resolution lowest-direct --extra paper --extra excel --extra parquet --extra plots \
	  pyproject.toml -o $(LOW)/constraints.txt
	$(LOW)/bin/uv pip install --quiet --python $(LOW)/bin/python -c $(LOW)/constraints.txt -e ".[paper,excel,parquet,plots]" \
	  pytest pytest-xdist hypothesis jaxtyping beartype distributed nbclient ipykernel
	$(ONE_THREAD) $(LOW)/bin/python -m pytest -n $(WORKERS) -W ignore::DeprecationWarning -m "not slow" $(PARTS) $(ARGS)

# The newest versions that pyproject.toml allows, in the same way; torch as it is locked, for a newer one pulls gigabytes.
NEW := .newest
newest: $(READY)
	$(BIN)/python -m venv $(NEW)
	grep -E '^torch==' constraints.txt > $(NEW)/held.txt
	$(NEW)/bin/python -m pip install --quiet --disable-pip-version-check --upgrade -c $(NEW)/held.txt -e ".[dev]"
	$(ONE_THREAD) $(NEW)/bin/python -m pytest -n $(WORKERS) -m "not slow" $(PARTS) $(ARGS)

# What nobody waits for, once a week: the versions at both ends, the slow tests, vulnerabilities, fuzz and mutation.
scheduled: newest lowest validate audit fuzz mutation

# Known vulnerabilities of what is locked; needs an index that answers for them, by default that of PyPI.
audit: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "pip-audit>=2.7"
	$(BIN)/pip-audit --disable-pip --no-deps -r constraints.txt $(ARGS)

# Which lines of the package the tests run; docs/validation.md has the number.
coverage: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "pytest-cov>=5"
	$(ONE_THREAD) $(BIN)/python -m pytest -n $(WORKERS) -m "not slow" --cov=bayesdamp --cov-report=term:skip-covered $(ARGS)

# The site, in docs/_build/html; a warning is an error. Notebooks run once, and again when they change.
docs: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev,docs]"
	$(ONE_THREAD) $(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html $(ARGS)
	@echo docs/_build/html/index.html

# What is installed now becomes the lock; the project itself is not part of it.
lock: $(READY)
	$(BIN)/python -m pip freeze --exclude-editable | sed -E 's/\+cpu$$//' | LC_ALL=C sort -f > constraints.txt.new
	mv constraints.txt.new constraints.txt

$(READY): pyproject.toml constraints.txt
	@set -e; \
	ok='import sys; sys.exit(sys.version_info < (3, 11))'; \
	for python in python3.11 python3 python3.12 python3.13; do \
	  "$$python" -c "$$ok" >/dev/null 2>&1 && break; python=; \
	done; \
	if [ -z "$$python" ]; then echo "Python 3.11 or later is needed; none was found" >&2; exit 1; fi; \
	$(BIN)/python -m pip --version >/dev/null 2>&1 || "$$python" -m venv $(VENV); \
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev]"; \
	$(BIN)/python -m compileall -q bayesdamp; \
	echo "compiling the equations of motion, once, about 15 s"; \
	$(BIN)/python -c "from bayesdamp.physics.kernel.solve import warm; warm()"; \
	touch $@

clean:
	rm -rf $(VENV) $(LOW) $(NEW) build docs/_build docs/_generated *.egg-info
