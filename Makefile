# `make demo` and `make test` start from a bare checkout: Python 3.11 or newer, a C compiler, git and make.
#
# PYTHON    the interpreter that makes the virtual environment
# PIP_ARGS  extra arguments for pip; on Linux with the public index and no GPU:
#           PIP_ARGS="--extra-index-url https://download.pytorch.org/whl/cpu"
# WORKERS   processes that share the tests
# ARGS      extra arguments for the demo or pytest: make test ARGS="-k replay -x"
PYTHON ?= python3
PIP_ARGS ?=
WORKERS ?= 2
ARGS ?=

VENV := .venv
BIN := $(VENV)/bin
PIP_INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt $(PIP_ARGS)
SOURCES := hotice tests benchmarks tools

.DEFAULT_GOAL := help
.PHONY: help demo test test-fast lint format type docs notebooks lab pictures readme benchmark install clean distclean

help: ## Show this list
	@awk 'BEGIN {FS = ":.*## "} /^[a-z-]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "hotice needs Python 3.11 or newer; pass one: make PYTHON=python3.11" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

# Stamps: one per set of installed packages, renewed when the pins or the package's metadata change.
$(VENV)/.core: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP_INSTALL) -e .
	@$(BIN)/python tools/check_no_cuda.py
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP_INSTALL) -e ".[dev,docs,drake,gpu,video,cluster,deploy,mcap]"
	@$(BIN)/python tools/check_no_cuda.py
	$(BIN)/python -m hotice warm
	@touch $@ $(VENV)/.core

$(VENV)/.lab: $(VENV)/.dev
	$(PIP_INSTALL) -e ".[notebook]"
	@touch $@

install: $(VENV)/.dev ## Install everything that tests and notebooks need

demo: $(VENV)/.core ## Carry boxes through a few scenes and write a replay page
	$(BIN)/python -m hotice.demo $(ARGS)

test: $(VENV)/.dev ## Run all tests
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal $(ARGS)
	@# what needs the machine for itself; 5: ARGS leave none of it
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --alone $(ARGS) || [ $$? -eq 5 ]

test-fast: $(VENV)/.dev ## Run the tests that are not marked slow
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal -m "not slow" $(ARGS)

lint: $(VENV)/.dev ## Check style and layout of the code
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/ruff format --check $(SOURCES)

format: $(VENV)/.dev ## Mend style and layout
	$(BIN)/ruff check --fix $(SOURCES)
	$(BIN)/ruff format $(SOURCES)

type: $(VENV)/.dev ## Check types
	$(BIN)/pyright

docs: $(VENV)/.dev ## Write the documentation with the API reference to build/site; any warning and any lost name fails
	OMP_NUM_THREADS=1 $(BIN)/python -m tools.site build/site

notebooks: $(VENV)/.dev ## Execute every notebook, with a short training
	HOTICE_TRAIN_MINUTES=$${HOTICE_TRAIN_MINUTES:-0.5} $(BIN)/python -m pytest --nbmake --nbmake-timeout=300 notebooks $(ARGS)

lab: $(VENV)/.lab ## Open the notebooks in JupyterLab
	$(BIN)/jupyter lab notebooks $(ARGS)

pictures: $(VENV)/.dev ## Execute the notebooks and keep their pictures in them
	$(BIN)/python -m tools.notebooks $(ARGS)

readme: $(VENV)/.dev ## Type whatever the README says to type, with small numbers
	$(BIN)/python -m tools.try_readme

benchmark: $(VENV)/.core ## Measure throughput
	$(BIN)/python -m hotice.learn benchmark $(ARGS)

clean: ## Remove caches and build products
	rm -rf build dist *.egg-info .pytest_cache .ruff_cache
	find hotice tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean ## Also remove the virtual environment
	rm -rf $(VENV)
