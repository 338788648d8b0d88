# make install   what is missing of Debian's packages (packages.txt), then .venv with PyPI's (requirements.txt) and stickslip
# make run       the first scene; its results are then in results/block
# make lint      style, types, and what could be unsafe
# make test      lint, and every test that is not slow
# make verify    every test, the verification problems, then `make debian13`
# make browser   Chromium by apt-get, if it is missing: `make verify` opens reports in it
# make debian13  on another Debian, as root: Debian 13 in a root of its own; see tests/platforms/debian13.sh
# make fuzz      inputs, files, environments, kills and tampering drawn by lot; N=20000: so many of each kind
# make dist      a wheel and a source archive, in dist
# make docs      runs every console block of the pages, then makes build/docs/index.html; five minutes or more
# make site      makes build/docs/index.html of the pages as they are; solves nothing; a minute
# make mutants   changes the code in small ways: does a test notice? ONLY="laws path": some modules of tests/mutation

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.ONESHELL:
.DEFAULT_GOAL := install
.PHONY: install run lint test verify browser debian13 dist fuzz docs site mutants again

PYTHON := /usr/bin/python3# Debian's own: its python3-* packages belong to no other
WORKERS ?= 2
N ?= 2000
SOURCES := stickslip # with links to geometry, solvers, workflows
STAMP := .venv/installed-at

# one thread per process: the tests run side by side, and mpirun starts several ranks
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
# several mpirun at a time, of more ranks than cores: share the cores, do not pin ranks to the same ones
export OMPI_MCA_hwloc_base_binding_policy := none
export OMPI_MCA_rmaps_base_oversubscribe := 1
# the same for Open MPI 5
export PRTE_MCA_hwloc_default_binding_policy := none
export PRTE_MCA_rmaps_default_mapping_policy := :oversubscribe
# nothing but .venv and Debian decides what `import geometry` finds
export PYTHONNOUSERSITE := 1
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV
# each of many processes would compile every module anew
unexport PYTHONDONTWRITEBYTECODE
ifeq ($(shell id -u),0)
export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
endif

PACKAGES := $(shell sed 's/#.*//' packages.txt)
# dpkg-query also complains about names that it does not know: these are missing like the others
MISSING := $(filter-out $(shell dpkg-query -W -f '$${db:Status-Status} $${Package}\n' $(PACKAGES) 2>/dev/null | sed -n 's/^installed //p'),$(PACKAGES))
# The stamp is written last and names its folder: an interrupted set-up, a moved folder or another Python shows here.
BROKEN := $(shell { [ "$$(cat $(STAMP))" = '$(CURDIR)' ] && .venv/bin/python -c '' && [ -x .venv/bin/stickslip ]; } >/dev/null 2>&1 || echo yes)

install: $(STAMP)

$(STAMP): packages.txt requirements.txt pyproject.toml Makefile $(if $(BROKEN)$(MISSING),again)
	@fail() { echo "make install: $$*" >&2; exit 1; }
	missing='$(strip $(MISSING))'
	if [ -n "$$missing" ]; then
	    command -v apt-get >/dev/null || fail "needs Debian 12 or 13, or a relative; there is no apt-get here to install: $$missing"
	    if [ "$$(id -u)" = 0 ]; then root=(env)
	    elif command -v sudo >/dev/null; then root=(sudo env)
	    else fail "neither root nor sudo; ask an administrator for: apt-get install --no-install-recommends $$missing"
	    fi
	    apt=("$${root[@]}" DEBIAN_FRONTEND=noninteractive apt-get -q -o Acquire::Retries=3 -o Dpkg::Use-Pty=0)
	    "$${root[@]}" DEBIAN_FRONTEND=noninteractive dpkg --configure -a  # an earlier set-up may have been interrupted
	    "$${apt[@]}" update || true  # one source out of reach need not matter: the next line decides
	    "$${apt[@]}" install -y --no-install-recommends $$missing
	fi
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 13)))' ||
	    fail "the pinned packages are for Python 3.11 (Debian 12) and 3.13 (Debian 13), and $(PYTHON) is $$($(PYTHON) -V)"
	rm -f $@
	if [ -n '$(BROKEN)' ]; then
	    rm -rf .venv
	    $(PYTHON) -m venv --system-site-packages .venv
	fi
	.venv/bin/python -m pip install -q --disable-pip-version-check -r requirements.txt
	.venv/bin/python -m pip install -q --disable-pip-version-check --no-index --no-build-isolation --no-deps -e .
	echo '$(CURDIR)' > $@

run: install
	.venv/bin/stickslip run block -o results/block

lint: install
	.venv/bin/ruff check
	.venv/bin/ruff format --check
	if [[ $$(.venv/bin/python -c 'import numpy; print(numpy.__version__)') = 1.* ]]; then .venv/bin/mypy -n $(WORKERS) $(SOURCES)
	else echo 'make lint: mypy is left out, for numpy 2 has other types than the numpy 1 of Debian 12'; fi

test: lint
	.venv/bin/python -m pytest -n $(WORKERS) -m 'not slow'

verify: install browser
	.venv/bin/python -m pytest -n $(WORKERS)
	.venv/bin/stickslip verify
	tests/platforms/debian13.sh

browser:
	@command -v chromium chromium-browser google-chrome >/dev/null && exit
	[ "$$(id -u)" = 0 ] && root=(env) || root=(sudo env)
	"$${root[@]}" apt-get -q update || true
	"$${root[@]}" DEBIAN_FRONTEND=noninteractive apt-get -q install -y --no-install-recommends chromium

debian13: install
	tests/platforms/debian13.sh

dist: install
	rm -rf dist build/lib
	.venv/bin/python -m pip wheel -q --disable-pip-version-check --no-index --no-build-isolation --no-deps -w dist .
	.venv/bin/python -c 'from setuptools import build_meta; build_meta.build_sdist("dist")' >/dev/null
	ls dist

fuzz: install
	FUZZ=$(N) .venv/bin/python -m pytest -n $(WORKERS) --timeout 0 tests/fuzz

PAGES := -q -W --keep-going -d build/doctrees docs build/docs

docs: install build/sphinx/installed
	.venv/bin/python -m stickslip.workflows.lab.pages.gallery
	.venv/bin/python -m stickslip.workflows.lab.pages.console README.md docs
	PYTHONPATH=$(CURDIR)/build/sphinx .venv/bin/python -m sphinx $(PAGES)

site: install build/sphinx/installed
	PYTHONPATH=$(CURDIR)/build/sphinx .venv/bin/python -m sphinx -D nb_execution_mode=off $(PAGES)

build/sphinx/installed: requirements-docs.txt
	rm -rf build/sphinx
	.venv/bin/python -m pip install -q --disable-pip-version-check --no-deps --target build/sphinx -r $<
	touch $@

mutants: install build/mutmut/installed
	PYTHONPATH=$(CURDIR)/build/mutmut .venv/bin/python tests/mutation/mutants.py $(ONLY)

build/mutmut/installed: requirements-mutants.txt
	rm -rf build/mutmut
	.venv/bin/python -m pip install -q --disable-pip-version-check --no-deps --target build/mutmut -r $<
	touch $@
