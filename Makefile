# `make demo` and `make test` set up all they need, in .venv; a second run sets up nothing that has not changed.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
APT := apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends

.PHONY: demo test lint clean

demo: $(VENV)/installed-core
	$(find_opencl)
	$(BIN)/aw4d demo -o out/demo

# Work is stolen in runs of neighbours, so that few workers make the same session fixtures.
test: $(VENV)/installed-test
	$(find_opencl)
	$(BIN)/python -m pytest --numprocesses auto --maxprocesses 8 --dist worksteal

lint: $(VENV)/installed-dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

clean:
	rm -rf $(VENV) build dist out/demo *.egg-info .*_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +

# No device is no failure: everything runs on NumPy too, slower.
define find_opencl
@if ! $(BIN)/aw4d doctor >/dev/null 2>&1; then \
	if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
		($(APT) pocl-opencl-icd) || echo "make: pocl-opencl-icd could not be installed" >&2; \
	fi; \
	$(BIN)/aw4d doctor >&2 || true; \
fi
endef

$(VENV)/installed-core: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable .
	@touch $@

$(VENV)/installed-%: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable '.[$*]'
	@touch $@

# Debian keeps ensurepip, which `venv` needs, in a package of its own.
$(BIN)/python:
	@if ! $(PYTHON) -c 'import ensurepip' 2>/dev/null; then \
		if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then $(APT) $(notdir $(PYTHON))-venv; \
		else echo "make: $(PYTHON) has no venv; on Debian or Ubuntu: sudo apt-get install $(notdir $(PYTHON))-venv" >&2; exit 2; fi; \
	fi
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "make: Python 3.11 or newer is needed, got $$($(PYTHON) --version); name another: make PYTHON=python3.12" >&2; \
		exit 2; }
	$(PYTHON) -m venv $(VENV)
