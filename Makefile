# `make train` and `make test` need nothing before them: they make .venv first, once.
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.setup-done
PYTHON ?= $(shell for p in python3 python3.12 python3.11 python3.13; do \
	"$$p" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null \
	&& { echo "$$p"; break; }; done)

TASK ?= pendulum
ARGS ?=
# Two workers share the kernel cache and compile its large kernels side by side (tests/compiled.py).
WORKERS ?= 2
# One thread per worker, or the workers fight over the cores.
ONE_THREAD := SIMWARP_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MPLBACKEND=Agg
# Bytecode is written even where the environment says otherwise: tests start hundreds of processes.
PYTEST := PYTHONDONTWRITEBYTECODE= $(ONE_THREAD) $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal
CODE := simwarp tasks train tests scripts benchmarks examples docs/conf.py

# The mark names the checkout. It does not count after the folder was moved, or where its Python no longer runs.
ifneq ($(shell $(BIN)/python -c pass 2>/dev/null && cat $(READY) 2>/dev/null),$(CURDIR))
.PHONY: $(READY)
endif

.PHONY: help setup bundle train test test-slow docs lint format clean

help:
	@echo "make setup      virtual environment with everything in it (the others do this by themselves)"
	@echo "make bundle     wheels and install.sh for a machine without network (ARGS='--python 3.12 --cuda')"
	@echo "make train      train a policy (TASK=$(TASK), ARGS='--num-envs 512')"
	@echo "make test       tests (ARGS='-k name'); test-slow adds the slow ones"
	@echo "make docs       the site: pages and API reference in build/docs"
	@echo "make lint       ruff and mypy; format rewrites"

setup: $(READY)
	@echo "next: . $(VENV)/bin/activate; simwarp list"

$(READY): pyproject.toml constraints.txt scripts/setup_env.py scripts/torch_build.py scripts/pip_calls.py
	@test -n "$(PYTHON)" || { echo "setup: no Python 3.11 to 3.13 found; set PYTHON=/path/to/python" >&2; exit 1; }
	@"$(PYTHON)" -m scripts.setup_env $(VENV)

bundle: $(READY)
	@$(BIN)/python -m scripts.bundle $(ARGS)

train: $(READY)
	@$(BIN)/simwarp train $(TASK) $(ARGS)

test: $(READY)
	@$(PYTEST) -m "not slow" $(ARGS)

test-slow: $(READY)
	@$(PYTEST) $(ARGS)

# A name or link that leads nowhere is an error. Pages of modules that are gone must not stay.
docs: $(READY)
	@rm -rf build/docs
	@$(BIN)/python -m sphinx --nitpicky --fail-on-warning --keep-going --quiet -b html -d build/doctrees docs build/docs
	@echo "site: build/docs/index.html"

# Without ruff's cache: import order depends on which folders exist, and a cached verdict does not see one move.
lint: $(READY)
	@status=0; \
	$(BIN)/ruff check --no-cache $(CODE) || status=1; \
	$(BIN)/ruff format --check $(CODE) || status=1; \
	$(BIN)/mypy simwarp tests scripts benchmarks examples || status=1; \
	exit $$status

format: $(READY)
	@$(BIN)/ruff check --fix $(CODE)
	@$(BIN)/ruff format $(CODE)

clean:
	rm -rf build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache
