# Every target prepares what it needs: only make and Python 3.11 or newer have to be there.
#
#   make up SCENARIO=fontana ARGS="--days 7 --speed max"
#   make test PYTEST_ARGS="-k settle"

SHELL := /bin/bash
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
PIP_INSTALL := $(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable
SCENARIO ?=
ARGS ?=
PYTEST_ARGS ?=
BENCH ?= $(wildcard benchmarks/*.py)

.PHONY: help up test lint format docs reference schemas bench policies clean

help:  ## list the targets
	@sed -nE 's/^([a-z]+):[^#]*## (.*)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 16

up: .venv/.base  ## run a market on this machine: SCENARIO=paper, ARGS="--days 7"
	$(BIN)/zengrid up $(SCENARIO) $(ARGS)

test: lint  ## all checks, then all tests but the slow ones: PYTEST_ARGS="-k settle"
	$(BIN)/pytest $(PYTEST_ARGS)

lint: .venv/.dev  ## ruff, mypy, the direction of imports, and prose
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/codespell
	$(BIN)/python tools/prose.py

format: .venv/.dev  ## let ruff mend what it can
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

docs: .venv/.dev  ## build the documentation into site/
	$(BIN)/mkdocs build --strict

reference: .venv/.dev  ## write the reference of all commands, docs/command-line.md
	$(BIN)/python tools/write_command_reference.py

schemas: .venv/.base  ## write the message schemas and the AsyncAPI document into docs/protocol
	$(BIN)/python tools/message_schemas.py docs/protocol

bench: .venv/.dev  ## run all benchmarks, or one: BENCH=benchmarks/lockstep.py ARGS="..."
	@set -e; for script in $(BENCH); do echo "== $$script"; $(BIN)/python $$script $(ARGS); done

policies: .venv/.dev  ## train the policies that come with zengrid anew, and evaluate them
	$(BIN)/python tools/train_shipped_policies.py $(ARGS)

clean:  ## remove the environment and everything that was built
	rm -rf .venv build dist site .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "zengrid needs Python 3.11 or newer, and found no python3.11 or python3" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "zengrid needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) --version). Name another: make PYTHON=..." >&2; exit 1; }
	$(PYTHON) -m venv .venv || { rm -rf .venv; echo "On Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }

# One stamp for each set of extras, so that a second run installs nothing.
.venv/.base: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP_INSTALL) .
	@touch $@

.venv/.dev: .venv/.base
	$(PIP_INSTALL) '.[dev,env,learn]'
	@touch $@
