# The commands of this project. Needed beforehand: Python 3.11, git, make (and a network, once).
#   make book       build the book into _build/html
#   make test       linter and tests, which include building the book from scratch
#   make check      linter, types and the tests of the method: minutes, for daily work
#   make lab        open the pages as notebooks in JupyterLab (builds the book where there is none)
#   make reproduce  compute everything again from nothing, compare, and draw the book from it
#   make oldest     test the library with the oldest versions allowed (make newest: with the newest)
#   make clean      remove what the above made (make distclean: the environment, too)

PYTHON ?= python3.11
VENV   ?= .venv
# For example --no-browser --port=9999.
LAB_OPTIONS ?=
# make reproduce ONLY="thesis" or ONLY="cartpole mountain-car" RUNS=2 JOBS=4
ONLY ?=
RUNS ?=
JOBS ?=
# make book ONLINE=yes: without the browser scripts, which pages then load from public servers.
ONLINE ?=

BIN     := $(VENV)/bin
PY      := $(BIN)/python -m
# Python 3.11, or where it is not on the path the one that the environment has.
SET_UP   = $$(command -v $(PYTHON) || echo $(BIN)/python) book/_ext/set_up.py $(VENV)
PYFILES := vtlib tests book/vtlab book/vtbook book/_ext
# Only pages with cells: the rest of the Markdown has no code to check.
PAGES    = $(shell grep -l '^kernelspec:' book/*.md)
# On a page an import may stand where it is first used, and a cell may end in a value to show.
PAGE_RULES := --extend-ignore=E402,B018
IMPORTS    := 'from importlinter.cli import lint_imports_command as check; check()'
METHOD     := $(wildcard $(patsubst vtlib/%.py,tests/test_%.py,$(wildcard vtlib/*.py))) tests/posteriors tests/native

# What a user has set for other work changes nothing here, and nothing is written outside this folder.
unexport PYTHONPATH PYTHONHOME PYTHONSTARTUP MPLBACKEND MATPLOTLIBRC
unexport PIP_TARGET PIP_PREFIX PIP_CONSTRAINT
export PYTHONNOUSERSITE := 1
export PYDEVD_DISABLE_FILE_VALIDATION := 1
export IPYTHONDIR := $(CURDIR)/_build/home/ipython
export MPLCONFIGDIR := $(CURDIR)/_build/home/matplotlib
export JUPYTER_CONFIG_DIR := $(CURDIR)/_build/home/jupyter-config
export JUPYTER_DATA_DIR := $(CURDIR)/_build/home/jupyter-data
export JUPYTER_RUNTIME_DIR := $(CURDIR)/_build/home/jupyter-runtime

.DEFAULT_GOAL := help
.PHONY: help book test check pytest lint format lab reproduce oldest newest clean distclean
.PHONY: set-up set-up-checks

help:
	@sed -n '/^#   make/s/^#   //p' Makefile

set-up:
	@$(SET_UP) book kernels

set-up-checks:
	@$(SET_UP) book kernels checks

book: set-up
	@echo "==> Building the book: 3 to 8 minutes the first time, seconds when little has changed."
	@$(BIN)/python book/_ext/build.py $(if $(ONLINE),--online)

# The book is built beside the other tests: one thread each, or they wait for each other.
test: export OMP_NUM_THREADS := 1
test: set-up-checks
	@echo "==> Testing: 12 minutes on two cores (linter, library, book from scratch, browser)."
	@$(MAKE) --no-print-directory -j2 lint pytest

pytest: set-up-checks
	@$(PY) pytest -n logical --dist loadfile --no-loadscope-reorder

check: export OMP_NUM_THREADS := 1
check: lint
	@$(PY) pytest -q -n logical --dist loadfile $(METHOD)

lint: set-up-checks
	@echo "==> Checking style, types and imports: a minute the first time, then seconds."
	@$(PY) ruff check $(PYFILES)
	@$(PY) ruff format --check $(PYFILES)
	@$(PY) mypy
	@$(BIN)/python -c $(IMPORTS) --no-cache --no-logo
	@PATH="$(BIN):$$PATH" $(PY) nbqa "ruff check" $(PAGES) $(PAGE_RULES)
	@PATH="$(BIN):$$PATH" $(PY) nbqa "ruff format --check" $(PAGES)

format: set-up-checks
	@$(PY) ruff check --fix $(PYFILES)
	@$(PY) ruff format $(PYFILES)

# Pages are copies of the built ones.
lab: set-up
	@ls _build/html/_sources/notebooks/* >/dev/null 2>&1 || $(MAKE) --no-print-directory book
	@echo "==> Opening JupyterLab: a few seconds; stop it with Ctrl-C. Pages are in notebooks/."
	@$(BIN)/python book/_ext/lab.py $(LAB_OPTIONS)

# The book is drawn from the new runs when there are all of them, and even if some differ.
reproduce: set-up
	@echo "==> Computing stored runs again from nothing: all of them take hours, see the time left."
	@echo "    Ctrl-C is safe: the same command goes on where it was stopped."
	@$(PY) vtlab reproduce $(addprefix --only ,$(ONLY)) $(addprefix --runs ,$(RUNS)) \
		$(addprefix --jobs ,$(JOBS)); code=$$?; \
	if [ $$code -le 1 ] && [ -z "$(ONLY)$(RUNS)" ]; then \
		$(BIN)/python book/_ext/build.py --results _build/reproduced || exit 1; \
	fi; exit $$code

# The library alone: the book's tools are pinned. What is deprecated there is no error here.
CPU_TORCH   := https://download.pytorch.org/whl/cpu
OF_THE_BOOK := $(addprefix tests/test_,$(addsuffix .py,assets book browser ceilings cells lab notebooks pages set_up wheel))
oldest newest: OTHER = _build/venv-$@
oldest newest: export OMP_NUM_THREADS := 1
oldest newest:
	@echo "==> Testing the library with the $@ versions, in $(OTHER): half an hour, and up to 6 GB."
	@test -x $(OTHER)/bin/python || $(PYTHON) -m venv $(OTHER)
	@$(OTHER)/bin/python -m pip install -q --retries 1 --timeout 30 --no-deps --index-url $(CPU_TORCH) \
		$$(grep '^torch' tests/requirements-$@.txt) 2>/dev/null || true
	@$(OTHER)/bin/python -m pip install -q --upgrade -r tests/requirements-$@.txt
	@$(OTHER)/bin/python -m pip install -q --no-deps -e . -e book
	@$(OTHER)/bin/python -m pytest -W default $(addprefix --ignore=,$(OF_THE_BOOK))

clean:
	rm -rf _build .pytest_cache .ruff_cache .mypy_cache .hypothesis .coverage htmlcov book/_static/vendor

distclean: clean
	rm -rf $(VENV) *.egg-info
