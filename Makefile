# make demo [DATA=FOLDER]   the whole way once: sensors in, motion out, a report to look at, in demo/
# make test                 the tests; real recordings are used where POSELOOM_DATA (or its default folder) holds them
# make check                style, types, layers, documents
# make benchmark            the figures of docs/benchmarks/core.md, measured again
# make clean                removes what make made, but not .venv

# The first Python that is new enough.
PYTHON := $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	"$$p" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo "$$p" && break; done)
BIN := .venv/bin
ONE_THREAD := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1

.PHONY: demo test check benchmark clean
.DEFAULT_GOAL := demo

demo: .venv/installed
	@$(BIN)/poseloom demo $(if $(DATA),--data "$(DATA)") -o demo

test: .venv/installed-dev
	@$(ONE_THREAD) $(BIN)/python -m pytest -n 2 --dist loadgroup --ignore tests/test_viewer_browser.py
	@# A browser that draws without a graphics card needs both cores.
	@$(ONE_THREAD) $(BIN)/python -m pytest tests/test_viewer_browser.py

check: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports
	$(BIN)/python scripts/check_docs.py

benchmark: .venv/installed
	@mkdir -p build
	$(BIN)/poseloom benchmark core --json build/core.json --markdown docs/benchmarks/core.md

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

.venv/installed: pyproject.toml constraints.txt | .venv/bin/pip
	@echo "Installing poseloom into .venv (about a minute, once)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[report]"
	@touch $@

.venv/installed-dev: pyproject.toml constraints.txt | .venv/bin/pip
	@echo "Installing poseloom and its development tools into .venv"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[dev]"
	@touch $@ .venv/installed
