# make demo | test | bench | lint: each sets up what it needs in .venv by itself, with pinned versions, and says what it does.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test bench lint demo-drive clean
.DEFAULT_GOAL := demo

demo: .venv/.service
	@echo "== demo: the shipped drive over a CAN bus, through the service, over Zenoh, to a subscriber in another process"
	$(BIN)/echogrid demo --out out/demo

test: .venv/.develop
	@echo "== test: service and training package; warnings are errors"
	$(BIN)/python -m pytest

bench: .venv/.develop
	@echo "== bench: ratios against named references, in one run"
	$(BIN)/python -m tests.bench

lint: .venv/.develop
	@echo "== lint: ruff and mypy (strict for the service)"
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy service training

# Draws the demo drive anew; the same seed gives the same bytes.
demo-drive: .venv/.develop
	$(BIN)/echogrid-train demo --out service/echogrid/demo_drive --force

.venv/.python:
	@echo "== a virtual environment in .venv"
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "echogrid needs Python 3.11 or newer; give one with: make PYTHON=python3.11")'
	$(PYTHON) -m venv .venv
	@touch $@

.venv/.service: .venv/.python requirements/service.txt pyproject.toml
	@echo "== the service and what it needs"
	$(BIN)/pip install --quiet -r requirements/service.txt
	$(BIN)/pip install --quiet --no-deps --editable .
	@touch $@

.venv/.develop: .venv/.service requirements/develop.txt training/pyproject.toml
	@echo "== the training package, tests and tools (PyTorch among them: this takes a few minutes)"
	$(BIN)/pip install --quiet -r requirements/develop.txt
	$(BIN)/pip install --quiet --no-deps --editable training
	@touch $@

clean:
	rm -rf .venv out build dist
