# `make table`: set up and print the baseline tables. `make test`: set up and pass the tests. `make check`: set up and
# compare the scores with those in scores.toml. No Julia needed.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin

.PHONY: table test test-full fuzz kills check lint format docs notebooks bench clean

table: $(VENV)/.installed
	$(BIN)/harness compare rocksample-7x8 --engine tables
	@echo
	$(BIN)/harness compare bordercross-7x8 --engine tables

test: $(VENV)/.installed-dev # a file's tests stay in one process, and share what they set up
	$(BIN)/python -m pytest -n 2 --dist loadfile

test-full: $(VENV)/.installed-dev # the slow ones in full size
	HARNESS_TESTS=full $(BIN)/python -m pytest -n 2 --dist loadfile

kills: $(VENV)/.installed-dev # SIGKILL and failing disks at everything that writes, each gone on with and compared
	$(BIN)/python -m tests.kills --strikes 300

check: $(VENV)/.installed
	$(BIN)/harness check

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(VENV)/.installed-dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(VENV)/.installed # warnings are errors; the pages are in build/docs
	$(BIN)/pip install -q -e '.[docs]'
	$(BIN)/python -m sphinx -W --keep-going -n -q -b html docs build/docs

notebooks: $(VENV)/.installed
	$(BIN)/pip install -q -e '.[notebooks]'
	$(BIN)/jupyter lab notebooks

bench: $(VENV)/.installed-dev
	$(BIN)/pip install -q -e '.[bench,cluster]'
	$(BIN)/python benchmarks/steps.py
	$(BIN)/python -m benchmarks.evolution
	$(BIN)/python -m benchmarks.solver
	$(BIN)/python -m benchmarks.gym
	$(BIN)/python -m benchmarks.planners
	$(BIN)/python -m benchmarks.cluster

fuzz: $(VENV)/.installed-dev # hostile inputs: files, texts, command lines
	$(BIN)/python -m tests.fuzz --count 100000

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -q -e .
	@touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	$(BIN)/pip install -q -e '.[dev,browser]'
	@touch $@

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache
