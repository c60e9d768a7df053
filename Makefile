# Two commands: `make demo` and `make test`. Both set up everything in .venv first. `make test-all`
# runs the slow tests too: whole studies, runs that are killed, every program of the docs. `make site`
# writes the documentation and the swim page to site/, ready for any host.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt
OUT ?= demo
NAME ?= here

.PHONY: demo test test-all lint bench site clean

demo: $(VENV)/.installed
	$(BIN)/salpchain demo --out $(OUT)

# Compiling takes most of the time of the tests. They share programs, with the next run too, and
# the older code generator of XLA takes half as long for code that is as quick.
test test-all: export JAX_COMPILATION_CACHE_DIR ?= $(HOME)/.cache/salpchain-tests
test test-all: export JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS ?= 0.2
test test-all: export XLA_FLAGS ?= --xla_cpu_use_fusion_emitters=false
test: SOME := -m "not slow"
test-all: SOME :=
test test-all: $(VENV)/.tested $(VENV)/.browser
	@find "$$JAX_COMPILATION_CACHE_DIR" -type f -mtime +14 -delete 2>/dev/null || true
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder $(SOME)

bench: $(VENV)/.tested
	$(BIN)/python -m benchmarks.run --name $(NAME) $(if $(OVERWRITE),--overwrite)

site: $(VENV)/.documented
	$(BIN)/python docs/site.py --out site

clean:
	rm -rf $(VENV)

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "salpchain needs Python 3.11 or later: make PYTHON=python3.12 ..." >&2; exit 2; }
	@$(PYTHON) -m venv $(VENV) || { echo "Python's venv is missing: install it (Debian: apt-get install python3-venv) and try again" >&2; exit 2; }

$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) --editable '.[live]'
	@touch $@

$(VENV)/.documented: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) --editable '.[docs,live]'
	@touch $@ $(VENV)/.installed

# torch first and alone: then nothing that needs it picks another build.
$(VENV)/.tested: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) torch==2.13.0
	$(PIP) --use-pep517 --editable '.[test]'
	@touch $@ $(VENV)/.installed

# Browser tests use the system's Chromium.
$(VENV)/.browser: | $(BIN)/python
	@command -v chromium >/dev/null || command -v chromium-browser >/dev/null || command -v google-chrome >/dev/null || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core >/dev/null; }; } || { echo "the browser tests need Chromium: install it (Debian: apt-get install chromium) and try again" >&2; exit 2; }
	@touch $@
