# `make demo` and `make test` do all the set-up on a fresh machine with Python 3.11 or newer and make.

.DEFAULT_GOAL := help
.PHONY: help demo blind app check test proof newest bench docs notebook lint lock clean

VENV := .venv
PY := $(VENV)/bin/python
STAMP := $(VENV)/.set-up
BENCH_STAMP := $(VENV)/.set-up-bench
DOCS_STAMP := $(VENV)/.set-up-docs
# The lock without its hashes: pip would ask for one of this project too.
CONSTRAINTS := $(VENV)/constraints.txt
PIP := $(PY) -m pip --disable-pip-version-check install -qq

# Where the demo finds a recorded campaign; without one, replay and identification are left out.
DEMO_CAMPAIGN ?= ../shared/data/campaigns/01
DEMO_OUT := results/demo
BLIND_OUT := results/blind
# More words for pytest: make test ARGS="-k replay -x"
ARGS ?=
# The rooms whose tests are quick: physics, files, the face. The tasks, the dashboard and the pages wait for `make test`.
CHECK = $(addprefix tests/,symbolic machines control references metrics effects simulate logs test_api.py test_imports.py)
# Containers often forbid bytecode; here it is kept, for the tests start many processes.
unexport PYTHONDONTWRITEBYTECODE
SOURCES = $(wildcard workbench tests benchmarks app.py)

# An environment whose interpreter has gone (a system upgrade) is set up again.
ifneq ($(shell [ -x $(PY) ] || echo gone),)
$(shell rm -f $(STAMP) $(BENCH_STAMP) $(DOCS_STAMP))
endif

help: ## this list
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' Makefile | expand -t 8

demo: $(STAMP) ## a study, a recorded campaign where there is one, and the diagnosis of a synthetic one
	@rm -rf $(DEMO_OUT)
	$(PY) -m workbench study scenarios/payloads.yaml --out $(DEMO_OUT)/study
	@if [ -d "$(DEMO_CAMPAIGN)" ]; then set -ex; \
	  $(PY) -m workbench replay "$(DEMO_CAMPAIGN)" --out $(DEMO_OUT)/replay; \
	  $(PY) -m workbench identify "$(DEMO_CAMPAIGN)" --out $(DEMO_OUT)/identify; \
	else echo "no recorded campaign at $(DEMO_CAMPAIGN): replay and identification are left out"; fi
	$(PY) -m workbench diagnose scenarios/demo_campaign --out $(DEMO_OUT)/diagnosis
	@echo; echo "Figures, each a page that needs no network:"; \
	find $(DEMO_OUT) -name '*.html' | sort | sed 's/^/  /'

blind: $(STAMP) ## twelve campaigns whose truth is sealed, diagnosed without it, then scored; a few minutes
	@rm -rf $(BLIND_OUT) $(BLIND_OUT).key $(BLIND_OUT)-score
	$(PY) -m workbench blind make --out $(BLIND_OUT) --cases 12
	$(PY) -m workbench blind run $(BLIND_OUT)
	$(PY) -m workbench blind score $(BLIND_OUT) --out $(BLIND_OUT)-score

app: $(STAMP) ## open the dashboard in a browser; Ctrl-C ends it
	@$(PY) -m workbench app

check: $(STAMP) ## ruff and the quick tests, for daily use
	$(PY) -m ruff check --quiet --output-format concise .
	$(PY) -m pytest -n 2 --dist worksteal -q $(CHECK) $(ARGS)

# worksteal: each worker begins with a stretch of whole files, so that what a file's tests share is made once.
test: $(STAMP) ## run all tests but the proofs
	$(PY) -m pytest -n 2 --dist worksteal $(ARGS)

# Before a release. Tests by hypothesis draw other and more examples here.
proof: $(STAMP) ## what `make test` leaves out: laws on more machines and recordings, many more examples
	WORKBENCH_REQUIRE_DATA=1 $(PY) -m pytest -n 2 --dist worksteal -m "proof or hypothesis" --hypothesis-profile proof $(ARGS)

# The kernels are LLVM's text, which changes from release to release: does the newest one still pass?
newest: ## the tests of kernels and simulation under the newest llvmlite, in an environment of its own
	@$(MAKE) -s VENV=$(VENV)-newest $(VENV)-newest/.set-up
	$(VENV)-newest/bin/python -m pip --disable-pip-version-check install -q --upgrade llvmlite
	$(VENV)-newest/bin/python -m pytest -n 2 tests/engine tests/machines tests/simulate $(ARGS)

bench: $(BENCH_STAMP) ## measure against the peers; writes benchmarks/results.json
	$(PY) -m benchmarks.run

docs: $(DOCS_STAMP) ## build the pages of docs/ as a site that needs no network; a warning is an error
	$(PY) -m sphinx -W --keep-going -q -d build/docs-cache docs build/docs
	@echo "open build/docs/index.html"

notebook: $(STAMP) ## run the cells of docs/log_to_decision.ipynb, keep their outputs and the picture of the README
	$(PY) docs/site/notebook.py docs/log_to_decision.ipynb

lint: $(STAMP) ## ruff and mypy, all three whatever the first one says
	@status=0; set -x; \
	$(PY) -m ruff check --output-format concise . || status=1; \
	$(PY) -m ruff format --check --output-format concise . || status=1; \
	$(PY) -m mypy $(SOURCES) || status=1; \
	{ set +x; } 2>/dev/null; exit $$status

lock: ## write requirements.lock anew for what pyproject.toml names; UPGRADE=1 takes the newest of all
	@$(MAKE) -s $(PY)
	@[ -x $(VENV)-lock/bin/uv ] || { $(PY) -m venv $(VENV)-lock && $(VENV)-lock/bin/python -m pip install -qq uv; }
	$(VENV)-lock/bin/uv pip compile pyproject.toml --extra app --extra blind --extra import --extra multibody --extra serve --extra test --extra dev \
	  --universal --python-version 3.11 --fork-strategy fewest --only-binary :all: \
	  --generate-hashes --no-emit-index-url --no-emit-find-links --no-annotate --custom-compile-command "make lock" \
	  $(if $(UPGRADE),--upgrade) --quiet -o requirements.lock

clean: ## remove the environment, the caches and the demo's results
	rm -rf $(VENV) $(VENV)-lock $(DEMO_OUT) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -not -path './.git/*' -prune -exec rm -rf {} +

# PYTHON=... chooses the interpreter.
$(PY):
	@found=; for python in $(PYTHON) python3.13 python3.12 python3.11 python3.14 python3 python; do \
	  if "$$python" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' 2>/dev/null; then \
	    found=$$python; break; fi; done; \
	if [ -z "$$found" ]; then echo "workbench needs Python 3.11 to 3.14; none is on the PATH (make PYTHON=/path/to/python ...)" >&2; exit 1; fi; \
	if ! "$$found" -c 'import ensurepip, venv' 2>/dev/null; then \
	  echo "$$found cannot make environments; on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; fi; \
	echo "setting up $(VENV) with $$("$$found" --version) (once, about a minute)"; \
	"$$found" -m venv --clear $(VENV)

# What is exactly pinned is installed, and nothing beside it: the build backend comes from the lock too.
# An environment without its stamp is a set-up that was interrupted: it is made anew.
$(STAMP): requirements.lock pyproject.toml Makefile
	@[ -f $@ ] || rm -rf $(VENV)
	@$(MAKE) -s $(PY)
	@echo "installing requirements.lock into $(VENV)"
	@$(PIP) --require-hashes -r requirements.lock
	@sed -n 's/ *\\$$//; /==/p' requirements.lock >$(CONSTRAINTS)
	@$(PIP) --no-deps --no-build-isolation -e .
	@touch $@

$(BENCH_STAMP): $(STAMP)
	@echo "installing the peers to measure against"
	@$(PIP) -c $(CONSTRAINTS) -e '.[bench]' --no-build-isolation
	@touch $@

$(DOCS_STAMP): $(STAMP)
	@echo "installing what builds the docs"
	@$(PIP) -c $(CONSTRAINTS) -e '.[docs]' --no-build-isolation
	@touch $@
