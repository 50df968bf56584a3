PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin

WORKERS := $(shell expr 2 '*' $$(getconf _NPROCESSORS_ONLN))

export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test test-fast coverage lint docs dist lowest clean

demo: $(VENV)/.run
	$(BIN)/arva-hil demo

# everything; twice as many workers as cores, for many tests wait
test: $(VENV)/.dev $(VENV)/.rewritten
	$(BIN)/python -m pytest --numprocesses $(WORKERS) --dist worksteal

# what runs in seconds, and waits little: at each save
test-fast: $(VENV)/.dev
	$(BIN)/python -m pytest --numprocesses $(shell expr 3 '*' $$(getconf _NPROCESSORS_ONLN) / 2) --dist worksteal -m 'not slow'

# of the tests that run the program in their own process; counted in all, it takes as long again as the tests
coverage: $(VENV)/.dev
	$(BIN)/python -m pytest --numprocesses auto --dist worksteal -m 'not slow or counted' --cov

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell
	$(BIN)/mypy

# the pages, without a warning, and their examples as tests; nothing is fetched
docs: $(VENV)/.dev
	$(BIN)/python -m sphinx -q -W --keep-going -n -d build/doctrees -b html docs build/docs
	$(BIN)/python -m sphinx -q -W --keep-going -n -d build/doctrees -b doctest docs build/doctest

# the wheel and the source archive, tried in empty environments: the wheel alone flies the demo, and what it brings is
# listed; with its extras it does every command line of the pages and the tutorial; the codec alone
dist: $(VENV)/.dist $(VENV)/.dev
	$(BIN)/python -m tools release
	rm -rf build dist
	$(BIN)/python -m build
	$(BIN)/twine check --strict dist/*
	$(PYTHON) -m venv build/whole
	build/whole/bin/python -m pip install --quiet dist/*.whl
	cd build && whole/bin/arva-hil demo --speed max
	$(BIN)/cyclonedx-py environment --output-file dist/sbom.json build/whole/bin/python
	build/whole/bin/python -m pip install --quiet "$$(ls dist/*.whl)[plots,mcap,foxglove]" pytest
	PROGRAM_UNDER_TEST=$(CURDIR)/build/whole/bin/arva-hil $(BIN)/python -m pytest --numprocesses $(WORKERS) tests/pages/test_command_lines.py tests/pages/test_tutorial.py
	$(PYTHON) -m venv build/codec
	build/codec/bin/python -m pip install --quiet --no-deps dist/*.whl fastcrc
	build/codec/bin/python -c "import firmware_proto as f; print(f.Decoder().feed(f.encode(f.Frame(1, 1, (f.Channel(1, 1, 1234, 17),))), 0.0))"

# the fast tests with the lowest versions that pyproject.toml allows at run time
lowest:
	mkdir -p build
	sed -n '/^dependencies/,/^]/s/ *"\(.*\)>=\(.*\)",/\1==\2/p' pyproject.toml >build/lowest.txt
	$(PYTHON) -m venv build/lowest
	build/lowest/bin/python -m pip install --quiet --constraint build/lowest.txt --editable '.[test]'
	build/lowest/bin/python -m pytest --numprocesses auto -m 'not slow'

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --editable '.[plots]'
	touch $@

$(VENV)/.dev: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --editable '.[test,lint]'
	touch $@ $(VENV)/.run

# pytest's own compiled form of the tests, kept beside them: made once, by two processes, and not by each worker
$(VENV)/.rewritten: $(VENV)/.dev
	ls -d tests/*/ tests/test_*.py | xargs -n 16 -P 2 $(BIN)/python -m pytest --quiet --collect-only --no-header >$@

$(VENV)/.dist: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet build cyclonedx-bom twine
	touch $@

clean:
	rm -rf $(VENV) build dist *.egg-info .coverage .mypy_cache .pytest_cache .ruff_cache .hypothesis
