# make demo [DATA=FOLDER]   the whole way once: sensors in, motion out, a report to look at, in demo/
# make test                 the tests; real recordings are used where POSELOOM_DATA (or its default folder) holds them
# make check                style, types, layers, documents and their site
# make docs                 the documents and the reference of every public name as a site, in build/site
# make benchmark            the figures of docs/benchmarks/core.md, measured again
# make clean                removes what make made, but not .venv
# Windows has no make: `python scripts/make.py TARGET` does the same.

# The first Python that is new enough.
PYTHON := $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	"$$p" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo "$$p" && break; done)
MAKE_PY := .venv/bin/python scripts/make.py

.PHONY: demo test check docs benchmark clean
.DEFAULT_GOAL := demo

# What each target does stands in scripts/make.py, which Windows runs itself.
demo: | .venv/bin/pip
	@$(MAKE_PY) demo $(if $(DATA),"$(DATA)")

test check docs benchmark: | .venv/bin/pip
	@$(MAKE_PY) $@

clean:
	rm -rf build dist demo .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find src tests examples scripts -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/bin/pip:
ifeq ($(PYTHON),)
	@echo "poseloom needs Python 3.11 or newer, and none was found: $$(python3 --version 2>&1 || true)" >&2
	@echo "Install one (Debian and Ubuntu: apt install python3 python3-venv), or give it: make PYTHON=/path/to/python3" >&2
	@exit 1
else
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "$(PYTHON) cannot make a virtual environment, for its modules venv and ensurepip are missing." >&2; \
		echo "Install them (Debian and Ubuntu: apt install python3-venv), then run make again." >&2; exit 1; }
	@$(PYTHON) -m venv .venv
endif
