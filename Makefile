# Everything is set up in .venv on the first use and not again until pyproject.toml or
# constraints.txt change. Needs Python 3.11 or newer, git and make; `make help` lists the targets.

.DEFAULT_GOAL := help
SHELL := /bin/sh

# A Python for which every pinned package has a wheel; `make PYTHON=/path/to/python ...` chooses
# another.
ifndef PYTHON
PYTHON := $(shell for p in python3 python3.13 python3.12 python3.11; do \
    "$$p" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null \
    && { echo "$$p"; exit; }; done; echo python3)
endif
VENV := .venv
BIN := $(VENV)/bin
STAMPS := $(VENV)/.stamps
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
WORKERS ?= 2
ARGS ?=
# What holds the slow tests without which no change lands: the package and the notebooks from a
# clean installation, the documentation with its links, and the bound on inverse rendering.
ACCEPTANCE := tests/test_distribution.py tests/test_docs.py tests/test_inverse.py

# Another environment's settings must not reach into ours.
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV

.PHONY: help demo test test-acceptance test-remaining test-slow lint format docs notebooks figures constraints llvm clean

help: ## List the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-15s %s\n", $$1, $$2 }' Makefile

demo: $(STAMPS)/package llvm ## Set up, compare Beryllium's Fresnel models, say where the pictures are
	$(BIN)/fresnel-decomp compare Be --out out/Be $(ARGS)
	@echo "The pictures are out/Be/curves.png and out/Be/renders.png"

test: $(STAMPS)/test llvm ## Set up and run the quick tests
	$(BIN)/python -m pytest -n $(WORKERS) -m "not slow" $(ARGS)

test-acceptance: $(STAMPS)/test $(STAMPS)/docs llvm ## Run the slow tests that come first
	$(BIN)/python -m pytest -n $(WORKERS) -m slow $(ACCEPTANCE) $(ARGS)

test-remaining: $(STAMPS)/test llvm ## Run the other slow tests
	$(BIN)/python -m pytest -n $(WORKERS) -m slow $(ACCEPTANCE:%=--ignore=%) $(ARGS)

test-slow: test-acceptance test-remaining ## Run the slow tests

lint: $(STAMPS)/lint ## Check style, format and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(STAMPS)/lint ## Repair style and format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(STAMPS)/docs llvm ## Build docs/_build/html; warnings and broken links are errors
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@PYTHONPATH=tests $(BIN)/python -c 'import sys, pathlib, links; \
	  sys.exit("\n".join(links.broken_links(pathlib.Path("docs/_build/html"))) or 0)' || { \
	  echo "Links that lead nowhere. In pages that are no more? make clean" >&2; exit 1; }
	@echo "Open docs/_build/html/index.html"

notebooks: $(STAMPS)/test llvm ## Execute the notebooks
	@mkdir -p out/notebooks
	@set -e; for f in notebooks/*.py; do \
	  $(BIN)/jupytext --quiet --to ipynb --output "out/notebooks/$$(basename "$$f" .py).ipynb" "$$f"; \
	done
	$(BIN)/python -m pytest -p no:xdist --nbmake --nbmake-timeout=600 out/notebooks

figures: $(STAMPS)/package llvm ## Make the figures that are not finished yet
	$(BIN)/python scripts/reproduce.py $(ARGS)

constraints: $(STAMPS)/test $(STAMPS)/lint $(STAMPS)/docs ## Pin what .venv holds now
	@{ sed -n '/^#/p' constraints.txt; \
	   $(BIN)/python -m pip list --format freeze --exclude-editable --disable-pip-version-check \
	   | grep -ivE '^(fresnel|setuptools|wheel)' | tr 'A-Z_' 'a-z-' | sort; } > constraints.new
	@mv constraints.new constraints.txt

clean: ## Remove everything that was made, .venv included
	rm -rf $(VENV) out build dist docs/_build jupyter_execute
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find src tests scripts -name __pycache__ -type d -prune -exec rm -rf {} +

# Where no LLVM can be had everything still runs, slower, in the scalar variants.
llvm: $(STAMPS)/package
	@$(BIN)/fresnel-decomp doctor --fix || echo "Going on without LLVM."

$(STAMPS)/venv:
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
	  echo "'$(PYTHON)' is $$("$(PYTHON)" --version 2>&1); needed: Python 3.11 or newer." >&2; \
	  echo "Install one, or name one: make PYTHON=/path/to/python3.11 ..." >&2; exit 1; }
	@"$(PYTHON)" -c 'import venv, ensurepip' 2>/dev/null || { \
	  echo "'$(PYTHON)' cannot make virtual environments: its venv or ensurepip module is missing." >&2; \
	  echo "On Debian and Ubuntu run: sudo apt-get install python3-venv" >&2; exit 1; }
	@echo "making $(VENV) with $$("$(PYTHON)" --version)"
	@"$(PYTHON)" -m venv --clear $(VENV)
	@$(PIP) --upgrade "pip>=25.1"
	@mkdir -p $(STAMPS) && touch $@

$(STAMPS)/package: $(STAMPS)/venv pyproject.toml constraints.txt
	@echo "installing the package"
	@$(PIP) --editable .
	@touch $@

$(STAMPS)/test $(STAMPS)/lint $(STAMPS)/docs: $(STAMPS)/%: $(STAMPS)/package
	@echo "installing what '$*' needs"
	@$(PIP) --group $*
	@touch $@
