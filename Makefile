# `make demo` and `make test` need Python 3.11+, its venv module and make; they set up all else.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

CORE := forcebound/haptics/laws/*,nodes/*,messages/*
# Least coverage of lines and branches, in %; to be raised with what is reached. Long runs count with
# their begin (tests/measured.py), campaigns not at all (no_cover).
COVERAGE := 88
CORE_COVERAGE := 90
FUZZ_SECONDS ?= 60# for each target
DAILY := -n 2 --dist loadgroup -m "not slow and not endurance"# of `make test` and `make coverage`

.PHONY: demo test tests checks-beside coverage check ruff mypy pyright imports test-slow examples \
  endurance proofs bench browser release reference docs fuzz hapi mutation clean

demo: $(STAMP)
	$(BIN)/forcebound demo

# The checks run beside the tests, in the time that these leave; what they say comes last.
test: $(STAMP)
	@$(MAKE) --no-print-directory --keep-going --jobs=2 tests checks-beside; ended=$$?; \
	  cat results/checks.txt; exit $$ended

tests: $(STAMP)
	$(BIN)/pytest $(DAILY) --durations=40 --durations-min=1

checks-beside: $(STAMP)
	@mkdir -p results; \
	  nice $(MAKE) --no-print-directory --keep-going pyright mypy ruff imports > results/checks.txt 2>&1

coverage: $(STAMP)
	$(BIN)/pytest $(DAILY) --cov --cov-report=term:skip-covered --cov-fail-under=$(COVERAGE)
	$(BIN)/coverage report --include='$(CORE)' --fail-under=$(CORE_COVERAGE) --format=total

# Two at a time; what each has to say comes when it is done.
check: $(STAMP)
	@$(MAKE) --no-print-directory --jobs=2 --output-sync pyright mypy ruff imports

ruff: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

mypy: $(STAMP)
	$(BIN)/mypy

pyright: $(STAMP)
	$(BIN)/pyright --pythonpath $(BIN)/python

imports: $(STAMP)
	$(BIN)/lint-imports

test-slow: $(STAMP)
	$(BIN)/pytest -m slow tests
	$(BIN)/pytest -n 2 -m "not slow and not live and not endurance and not examples" --hypothesis-profile=random

endurance: $(STAMP)
	$(BIN)/pytest -m endurance --junit-xml=results/endurance.xml

examples: $(STAMP)
	examples/build.sh; built=$$?; $(BIN)/pytest -m examples -rs && exit $$built

# The campaigns of the proofs and their pages: an hour or two on two idle cores. The attacks come
# first; a leak of a certified law ends it.
proofs: $(STAMP)
	$(BIN)/python -m forcebound_proofs lemmas
	$(BIN)/forcebound audit --runs 1000 --search 1000 --output proofs/docs/audit.md
	$(BIN)/forcebound audit worlds --runs 60 --search 60 --output proofs/docs/audit-worlds.md
	$(BIN)/forcebound audit sensitivity
	$(BIN)/python -m forcebound_proofs certificate_grid --page proofs/docs/prices.md
	@mkdir -p results
	$(BIN)/forcebound league --output docs/league.md --table results/league.parquet --restart
	$(BIN)/forcebound reproduce
	$(BIN)/python -m forcebound_proofs identification_bounds
	$(BIN)/python -m forcebound_proofs late_ticks
	$(BIN)/python -m forcebound_proofs far_wall --plot docs/far_wall.png
	$(BIN)/pytest -m slow proofs/tests

# One row for each benchmark with date, commit and machine, all rounds beside it; some ten minutes on
# an idle machine, refused (status 2) on a busy one; status 1: written, but a target was missed.
bench: $(STAMP)
	$(BIN)/python -m benchmarks --page docs/benchmarks.md

# The pages of all keys of launch files and of all figures of a run, from their tables.
reference: $(STAMP)
	$(BIN)/python docs/launch_files.py > docs/launch-files.md
	$(BIN)/python docs/results.py > docs/results.md

# The site, from the Markdown files: results/site/index.html. A warning, such as of a link that leads
# nowhere, is an error.
docs: $(STAMP)
	@$(BIN)/python -c 'import furo, myst_parser, sphinx_copybutton' 2>/dev/null \
	  || $(BIN)/python -m pip install --quiet --disable-pip-version-check \
	    --constraint constraints.txt --editable '.[docs]'
	$(BIN)/sphinx-build -q -E -W --keep-going -d results/doctrees -c docs . results/site
	@echo "open results/site/index.html"

# Everything up to the upload, which a person does: `twine upload dist/*`.
release: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[release]'
	rm -rf build dist
	$(BIN)/python -m build
	$(BIN)/twine check --strict dist/*
	$(BIN)/pytest -m "slow or not slow" tests/test_wheel.py

mutation: $(STAMP)
	@$(BIN)/python -c 'import mutmut' 2>/dev/null \
	  || $(BIN)/python -m pip install --quiet --disable-pip-version-check \
	    --constraint constraints.txt --editable '.[mutation]'
	$(BIN)/python tests/mutation.py

fuzz: $(STAMP)
	@$(BIN)/python -c 'import atheris' 2>/dev/null \
	  || $(BIN)/python -m pip install --quiet --disable-pip-version-check --only-binary atheris \
	    --constraint constraints.txt --editable '.[fuzz]' \
	  || { echo "atheris, which fuzzes, has no wheel for this machine and `$(BIN)/python --version`;"; \
	    echo "it has them for Linux: try make fuzz VENV=.venv-fuzz PYTHON=python3.11"; exit 2; }
	$(BIN)/python fuzz/campaign.py --seconds $(FUZZ_SECONDS)

# The page in Debian's Chromium (packages chromium and chromium-driver), by selenium, and in Firefox
# (firefox-esr), by WebDriver BiDi; `make test` runs the former. A browser that is missing is skipped.
browser: $(STAMP)
	$(BIN)/pytest -rs -m live tests/test_view_browser.py tests/test_view_firefox.py tests/test_page_layout.py

# The maker's own client of the Haply 2DIY against our emulator. It is under the GPL and puts an
# __init__.py beside all packages, so it gets a folder of its own and is in no extra.
hapi: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade --no-deps \
	  --constraint constraints.txt --target results/hapi HaplyHAPI
	PYTHONPATH=results/hapi $(BIN)/pytest -m live -k maker tests/test_emulators_live.py

$(STAMP): pyproject.toml proofs/pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "forcebound needs Python 3.11 or newer; $(PYTHON) is `$(PYTHON) --version`."; \
	  echo "Name another one: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 2; }
	@$(PYTHON) -c 'import ensurepip, venv' || { \
	  echo "Python's venv module is missing; on Debian and Ubuntu: apt install python3-venv"; exit 2; }
	@echo "Installing into $(VENV): a minute or more."
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --disable-pip-version-check \
	  --constraint constraints.txt --editable '.[dev]' --editable 'proofs[proof]'
	@touch $(STAMP)

clean:
	rm -rf $(VENV) build dist *.egg-info results .mypy_cache .ruff_cache .pytest_cache .hypothesis
	rm -rf examples/cpp/wall examples/cpp/device examples/javascript/node_modules examples/rust/target examples/rust/Cargo.lock
