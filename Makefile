# The commands of this project. Needed beforehand: Python 3.11, git, make (and a network, once).
#   make book       build the book into _build/html
#   make test       linter and tests, which include building the book from scratch
#   make lab        open the pages as notebooks in JupyterLab (builds the book where there is none)
#   make reproduce  compute everything again from nothing, compare, and draw the book from it
#   make oldest     test the library with the oldest versions allowed (make newest: with the newest)
#   make sanitize   run the kernels on random settings under the sanitizers (needs g++)
#   make clean      remove what the above made (make distclean: the environment, too)

PYTHON ?= python3.11
VENV   ?= .venv
# For example --no-browser --port=9999.
LAB_OPTIONS ?=
# make reproduce ONLY="thesis" or ONLY="cartpole mountain-car" RUNS=2 JOBS=4, or SCHEDULER=tcp://host:8786; DEVICE=cuda
ONLY ?=
RUNS ?=
JOBS ?=
SCHEDULER ?=
DEVICE ?=
# make book ONLINE=yes: without the browser scripts, which pages then load from public servers.
ONLINE ?=

BIN     := $(VENV)/bin
SET_UP  := $(VENV)/set-up-is-done
CHECKS  := $(VENV)/checks-are-installed
KERNELS := vtlib/native/lib/up-to-date
PYFILES := vtlib tests book/vtlab book/vtbook book/_ext
# Only pages with cells: the rest of the Markdown has no code to check.
PAGES    = $(shell grep -l '^kernelspec:' book/*.md)
# On a page an import may stand where it is first used, and a cell may end in a value to show.
PAGE_RULES := --extend-ignore=E402,B018
CPU_TORCH := https://download.pytorch.org/whl/cpu
TORCH     := $(shell sed -n 's/^\(torch==[^ ]*\).*/\1/p' requirements.txt)

export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PYDEVD_DISABLE_FILE_VALIDATION := 1

.DEFAULT_GOAL := help
.PHONY: help book test pytest lint format lab reproduce oldest newest sanitize clean distclean

help:
	@sed -n '/^#   make/s/^#   //p' Makefile

book: $(KERNELS)
	@echo "==> Building the book: 3 to 8 minutes the first time, seconds when little has changed."
	@$(BIN)/python book/_ext/build.py $(if $(ONLINE),--online)

# The book is built beside the other tests: one thread each, or they wait for each other.
test: export OMP_NUM_THREADS := 1
test: $(KERNELS) $(CHECKS)
	@echo "==> Testing: 10 to 30 minutes on two cores (linter, library, book from scratch, browser)."
	@$(MAKE) --no-print-directory -j2 lint pytest

pytest: $(KERNELS) $(CHECKS)
	@$(BIN)/python -m pytest -n logical --dist loadfile --no-loadscope-reorder

lint: $(KERNELS) $(CHECKS)
	@echo "==> Checking style, types, imports and language: a minute the first time, then seconds."
	@$(BIN)/ruff check $(PYFILES)
	@$(BIN)/ruff format --check $(PYFILES)
	@$(BIN)/mypy
	@$(BIN)/lint-imports --no-cache --no-logo
	@PATH="$(abspath $(BIN)):$$PATH" $(BIN)/nbqa "ruff check" $(PAGES) $(PAGE_RULES)
	@PATH="$(abspath $(BIN)):$$PATH" $(BIN)/nbqa "ruff format --check" $(PAGES)
	@$(BIN)/python book/_ext/prose.py

format: $(CHECKS)
	@$(BIN)/ruff check --fix $(PYFILES)
	@$(BIN)/ruff format $(PYFILES)
	@PATH="$(abspath $(BIN)):$$PATH" $(BIN)/nbqa "ruff format" $(PAGES)

# Settings go into the environment, not into the user's home. Pages are copies of the built ones.
lab: export JUPYTER_CONFIG_DIR := $(abspath $(VENV))/etc/jupyter-user
lab: export JUPYTER_DATA_DIR := $(abspath $(VENV))/share/jupyter-user
lab: $(KERNELS)
	@ls _build/html/_sources/notebooks/* >/dev/null 2>&1 || $(MAKE) --no-print-directory book
	@echo "==> Opening JupyterLab: a few seconds; stop it with Ctrl-C. Pages are in notebooks/."
	@$(BIN)/python book/_ext/lab.py $(LAB_OPTIONS)

# The book is drawn from the new runs when there are all of them, and even if some differ.
reproduce: $(KERNELS)
	@echo "==> Computing stored runs again from nothing: all of them take hours, see the time left."
	@echo "    Ctrl-C is safe: the same command goes on where it was stopped."
	@$(BIN)/python -m vtlab reproduce $(addprefix --only ,$(ONLY)) $(addprefix --runs ,$(RUNS)) \
		$(addprefix --jobs ,$(JOBS)) $(addprefix --scheduler ,$(SCHEDULER)) \
		$(addprefix --device ,$(DEVICE)); code=$$?; \
	if [ $$code -le 1 ] && [ -z "$(ONLY)$(RUNS)" ]; then \
		$(BIN)/python book/_ext/build.py --results _build/reproduced || exit 1; \
	fi; exit $$code

# The library alone: the book's tools are pinned. What is deprecated there is no error here.
OF_THE_BOOK := $(addprefix tests/test_,$(addsuffix .py,assets book browser chapters notebooks pages))
oldest newest: OTHER = _build/venv-$@
oldest newest: export OMP_NUM_THREADS := 1
oldest newest:
	@echo "==> Testing the library with the $@ versions, in $(OTHER): half an hour, and up to 6 GB."
	@test -x $(OTHER)/bin/python || $(PYTHON) -m venv $(OTHER)
	@$(OTHER)/bin/pip install -q --retries 1 --timeout 30 --no-deps --index-url $(CPU_TORCH) \
		$$(grep '^torch' tests/requirements-$@.txt) 2>/dev/null || true
	@$(OTHER)/bin/pip install -q --upgrade -r tests/requirements-$@.txt
	@$(OTHER)/bin/pip install -q --no-deps -e . -e book
	@$(OTHER)/bin/python -m pytest -W default $(addprefix --ignore=,$(OF_THE_BOOK))

sanitize:
	@mkdir -p _build
	@g++ -std=c++17 -O1 -g -march=native -Wno-psabi -fsanitize=address,undefined \
		-fno-sanitize-recover=all -Ivtlib/native tests/vtlab/native/fuzz.cpp -o _build/fuzz
	@_build/fuzz 100

clean:
	rm -rf _build .pytest_cache .ruff_cache .mypy_cache .hypothesis .coverage htmlcov book/_static/vendor

distclean: clean
	rm -rf $(VENV) *.egg-info

# The environment. Made anew only when a pinned version or the package's metadata changes.
$(SET_UP): requirements.txt pyproject.toml book/pyproject.toml
	@echo "==> Setting up $(VENV) (once): about 2 minutes and 1.5 GB with a good connection."
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || \
		{ echo "Python 3.11 is needed: make PYTHON=/path/to/python3.11 book"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "--> 1 of 3: PyTorch, the build without CUDA"
	@$(BIN)/pip install -q --retries 1 --timeout 30 --no-deps --index-url $(CPU_TORCH) $(TORCH) \
		2>$(VENV)/torch.log || { \
		echo "    PyTorch's own index cannot be reached: taking it from the ordinary one (larger)"; \
		$(BIN)/pip install --progress-bar off $(TORCH) >$(VENV)/torch.log 2>&1; } || \
		{ tail -n 20 $(VENV)/torch.log; exit 1; }
	@echo "--> 2 of 3: everything else, at the versions and with the digests of requirements.txt"
	@$(BIN)/pip install --progress-bar off --require-hashes -r requirements.txt \
		>$(VENV)/install.log 2>&1 || { tail -n 20 $(VENV)/install.log; exit 1; }
	@echo "--> 3 of 3: vtlib and the pages' package, in place"
	@$(BIN)/pip install -q -e . -e book --no-deps --no-build-isolation
	@$(BIN)/pip check
	@touch $@

# What only the checks need: linters, test tools, drivers of browsers.
$(CHECKS): $(SET_UP) requirements-checks.txt
	@echo "==> Installing what the checks need, with the digests of requirements-checks.txt"
	@$(BIN)/pip install --progress-bar off --require-hashes -r requirements-checks.txt \
		>$(VENV)/checks.log 2>&1 || { tail -n 20 $(VENV)/checks.log; exit 1; }
	@touch $@

# The loops in C++, compiled again when their sources change.
NATIVE := $(wildcard vtlib/native/*.* book/vtlab/native/*.cpp book/vtlab/native/*.h) book/vtlab/native/build.py
$(KERNELS): $(SET_UP) $(NATIVE)
	@$(BIN)/python -m vtlib.native
	@$(BIN)/python -m vtlab.native
	@mkdir -p $(@D) && touch $@
