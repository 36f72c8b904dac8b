.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.NOTPARALLEL:
SHELL := /bin/bash

PINS := $(filter-out requirements/snakemake.txt requirements/benchmarks.txt requirements/docs.txt requirements/fmi.txt requirements/release.txt, $(wildcard requirements/*.txt)) pyproject.toml

# The form compiler calls cc at run time, WeasyPrint loads Pango and HarfBuzz, gmsh (without a window) X libraries,
# and on Debian's default BLAS a MUMPS factor takes six times as long as on OpenBLAS.
APT := python3-dolfinx-real python3-petsc4py-real python3-slepc4py-real openmpi-bin libopenblas0-serial \
       gcc libc6-dev python3-dev python3-venv \
       libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0 libgl1 fonts-dejavu-core \
       libglu1-mesa libxft2 libxcursor1 libxinerama1 libxfixes3 libxrender1 libgomp1 $(and $(filter true,$(CI)),calculix-ccx)

# Nothing of the caller's Python or PETSc may leak in: Debian's petsc4py dies beside a NumPy 2 of the user's own.
unexport PYTHONPATH PYTHONHOME PETSC_DIR PETSC_ARCH SLEPC_DIR PIP_USER PIP_TARGET PIP_PREFIX
# Images for containers preset it; without stored bytecode each process compiles for seconds all that it imports.
unexport PYTHONDONTWRITEBYTECODE
export PYTHONNOUSERSITE := 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Ranks share the cores; BLAS threads on top would fight over them.
export OMP_NUM_THREADS := 1
# MPI as root, with fewer cores than ranks, in a container; no run outlives a deadlock by more than an hour.
export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
export OMPI_MCA_rmaps_base_oversubscribe := 1
export OMPI_MCA_hwloc_base_binding_policy := none
export OMPI_MCA_btl_vader_single_copy_mechanism := none
export HYDRA_LAUNCHER := fork
export MPIEXEC_TIMEOUT := 3600
# A rank that waits lets others compute: there may be more of them than cores.
export OMPI_MCA_mpi_yield_when_idle := 1

# OpenBLAS chooses its kernel by the processor, and with it the round-off; so that every machine tests the same, it is
# named, whatever the environment presets.  The suite runs under KERNEL, its numerical part under all that this
# processor can run (none where there is no OpenBLAS for x86).
KERNELS := $(shell grep -qw avx2 /proc/cpuinfo && echo Haswell; grep -qw sse4_2 /proc/cpuinfo && echo Nehalem; \
    grep -qw avx512vl /proc/cpuinfo && echo SkylakeX)
KERNEL := $(firstword $(KERNELS))
OTHERS := $(filter-out $(KERNEL),$(KERNELS))

# $(call pytest,VENV,KERNEL,OPTIONS): the suite, with the venv's own commands (mpirun too) first on PATH.
pytest = @$(if $2,OPENBLAS_CORETYPE=$2 )PATH="$(CURDIR)/$1/bin:/usr/bin:$$PATH" python -m pytest $3 </dev/null

# $(call ranks,VENV,KERNEL,MPIRUN,MARKS): the marked tests on two ranks. Rank 1 speaks only when something failed;
# through mpi4py a failing rank ends the other one, which would wait for it. Those of Open MPI share a core: one that waits
# gives way to the other, so that together they take less processor time than on two cores, and another target runs on the
# other. Those of MPICH do not give way: on one core they take five times as long.
OPENMPI := taskset -c $$(taskset -cp $$$$ | sed 's/.*[:,-] *//') /usr/bin/mpirun
define ranks
@log=$$(mktemp -d); PATH="$(CURDIR)/$1/bin:/usr/bin:$$PATH"; $(if $2,export OPENBLAS_CORETYPE=$2;) \
$3 -n 2 /bin/sh -c 'r=$${OMPI_COMM_WORLD_RANK:-$$PMI_RANK}; [ "$$r" = 0 ] || exec >"$$0/$$r" 2>&1; exec "$$@"' \
    "$$log" python -m mpi4py -m pytest -q -x --color=no -m "$4" -p no:cacheprovider </dev/null; status=$$?; \
[ $$status = 0 ] || { echo '--- rank 1:'; cat "$$log"/*; }; rm -rf "$$log"; exit $$status
endef

# $(call numerical,VENV,KERNEL,LESS): the numerical part under one kernel on one rank, but for some.
define numerical
@echo "numerical part$3, $1, BLAS kernel $2"
$(call pytest,$1,$2,-q -m "numerical$3")
endef

.PHONY: help
help: ## say what there is
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

# $(call pinned,VENV,STACK): what pip installs into an environment later leaves the versions that fit together.
define pinned
@sed -n '/==/{s/ *#.*//;p}' requirements/{common,$2,constraints}.txt >$1/pins.txt
@printf '[install]\nconstraint = file://%s/$1/pins.txt\n' "$${PWD// /%20}" >$1/pip.conf
endef

.PHONY: setup
setup: .venv/.ready .venv/.kernel ## install what is missing or changed: Debian packages, then the pinned Python ones into .venv
	@.venv/bin/python .ci/versions .venv/pins.txt || { rm $<; $(MAKE) --no-print-directory $<; }

.venv/.ready: $(PINS)
	@. /etc/os-release 2>/dev/null; [ "$$ID-$$VERSION_ID" = debian-12 ] || { \
	    echo "make sets up Debian 12 only; elsewhere: pip install '.[fenicsx]' with Python 3.12+, or conda's fenics-dolfinx and pip install ." >&2; exit 1; }
	@missing=; for p in $(APT); do \
	    [ "$$(dpkg-query -W -f='$${db:Status-Status}' $$p 2>/dev/null)" = installed ] || missing="$$missing $$p"; done; \
	[ -z "$$missing" ] || { \
	    echo "installing Debian packages:$$missing"; as_root=; [ "$$(id -u)" = 0 ] || as_root=sudo; \
	    $$as_root apt-get -q update >/dev/null && \
	    $$as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends $$missing >/dev/null; }
	@echo "installing Python packages into .venv"
	@/usr/bin/python3 -m venv --system-site-packages .venv
	$(call pinned,.venv,debian)
	@.venv/bin/python -m pip install -q --no-compile -r requirements/debian.txt
	@.venv/bin/python -m pip install -q --no-deps --no-build-isolation -e .
	@rmdir .venv/lib/python3*/site-packages/pmr 2>/dev/null || true # left empty by an earlier installation, it would hide the package
	@touch $@

# The kernel in C, in place, where its sources have changed.
KERNEL_SOURCES := $(wildcard pmr/kernel/src/*.[ch] pmr/export/fmi/source/*.[ch]) pmr/kernel/build.py tools/cross.py setup.py
.venv/.kernel: $(KERNEL_SOURCES) | .venv/.ready
	@.venv/bin/python setup.py -q build_ext --inplace
	@touch $@

# Wheels with the kernel compiled by zig, each for a system and for all versions of Python from 3.11 on.
WHEELS := x86_64-linux aarch64-linux x86_64-darwin aarch64-darwin x86_64-windows

.PHONY: wheels
wheels: $(WHEELS:%=wheel-%) ## dist: wheels for Linux and macOS (x86-64, Arm) and Windows (x86-64), compiled by zig

wheel-%: setup
	@rm -rf build/wheels/$*
	@PMR_TARGET=$* .venv/bin/python setup.py -q build --build-base build/wheels/$* bdist_wheel --dist-dir dist

# Only a release wants it: cffconvert needs older packages than pmr.
.venv-release/.ready: requirements/release.txt
	@/usr/bin/python3 -m venv .venv-release
	@.venv-release/bin/python -m pip install -q --no-compile -r requirements/release.txt
	@touch $@

.PHONY: release
release: .venv-release/.ready ## dist: sources and wheels, checked in fresh environments by the first boom; nothing is uploaded
	@.venv-release/bin/cffconvert --validate
	@rm -rf dist && .venv-release/bin/python -m build -q --sdist
	@$(MAKE) --no-print-directory wheels
	@.venv-release/bin/twine check --strict dist/*
	@.ci/release dist /usr/bin/python3 "$(PYTHON312)"

.PHONY: report
report: setup ## the paper's two cases, full against reduced: reports/paper/report.html and .pdf
	@.venv/bin/pmr run workflows/paper_simple.toml workflows/paper_evolved.toml --out reports/paper
	@echo "all is well: both cases are computed; look at reports/paper/report.html (warnings say where figures are rough)"

.PHONY: paper
paper: setup ## every experiment of the paper, figures and tables in one report: reports/paper_experiments (some minutes)
	@.venv/bin/pmr study paper --out reports/paper_experiments

# What is compared with, and nothing else needs.
.venv/.bench: requirements/benchmarks.txt .venv/.ready
	@.venv/bin/python -m pip install -q --no-compile -r requirements/benchmarks.txt
	@touch $@

.PHONY: bench
bench: setup .venv/.bench ## ratios to the paper's way, peers, the machine's limit: reports/benchmarks (some minutes, quiet machine)
	@.venv/bin/python -m benchmarks

.PHONY: bench-full
bench-full: setup .venv/.bench ## the same with the paper's way over its whole time span, and a million coordinates
	@.venv/bin/python -m benchmarks --long

# What builds the manual, and nothing else needs.
.venv/.docs: requirements/docs.txt .venv/.ready
	@.venv/bin/python -m pip install -q --no-compile -r requirements/docs.txt
	@touch $@

.PHONY: docs
docs: setup .venv/.docs ## the manual: docs/_build/html/index.html, which needs no network
	@.venv/bin/python -m sphinx -q -W --keep-going -b html docs docs/_build/html
	@echo "the manual: docs/_build/html/index.html"

.PHONY: docs-check
docs-check: setup .venv/.docs ## the same without executing the examples, which the tests do
	@.venv/bin/python -m sphinx -q -W --keep-going -b html -D plot_gallery=0 docs docs/_build/check

.PHONY: manual
manual: ## commands and Python of the manual, from a wheel in fresh environments (Python 3.12; LONG=--long for all)
	@.ci/manual "$(PYTHON312)" $(LONG)

# $(call both,TARGETS,ALONE): TARGETS on two cores at once. Whichever is through with a target goes on with the next one
# that nobody has begun, so that no core waits; what the other one says is shown at the end. Then ALONE one by one:
# ranks of MPICH wait for each other at every step, and beside another process take four times as long; two targets with
# ranks of Open MPI would meet on one core.
define both
@logs=$$(mktemp -d); go_on() { for target in "$$@"; do mkdir "$$logs/$$target" 2>/dev/null || continue; \
    $(MAKE) --no-print-directory $$target </dev/null || echo "failed: make $$target" >>"$$logs/failed"; done; }; \
go_on $1 >"$$logs/beside" 2>&1 & go_on $1; wait; cat "$$logs/beside"; go_on $2; \
cat "$$logs/failed" 2>/dev/null; [ ! -e "$$logs/failed" ]; status=$$?; rm -rf "$$logs"; exit $$status
endef

# What CI runs: the suite on Debian's stack, COMPARE under the kernels between and all else under KERNEL; on the wheel
# stack, under the last kernel, what tests/conftest.py marks `stack`; under the kernels between, on Debian's, the tests
# for two ranks on two. So each stack and each kernel has its turn, and what is numerical and quick runs under two of
# them; `make test` runs all of it under all. Left out on the wheel stack, as they run on Debian's: what only reads scenes
# and pages, slow tests but first cases of FEniCSx itself, further cases of tests that are neither numerical nor of
# FEniCSx, and on two ranks slow tests and further cases. The longest begin first and the shortest end: a core waits for
# the last of them. LONGEST and LAST are what .ci/run adds.
LAST_KERNEL := $(lastword $(KERNELS))
BETWEEN := $(filter-out $(KERNEL) $(LAST_KERNEL),$(KERNELS))
LONGEST =
LAST =
IN_CI = $(call both,test-suite-rest test-wheel-part test-suite-report test-suite-compare $(LONGEST) test-suite-rooms \
    $(or $(BETWEEN:%=test-mpi-%),test-mpi) lint $(LAST),test-wheel-part-mpi)
ALONE = $(call both,lint $(SUITE) test-mpi $(OTHERS:%=test-numerical-%) $(LONGEST) $(LAST),$(OTHERS:%=test-ranks-%))
BOTH_STACKS = $(and $(filter true,$(CI)),$(PYTHON312))
# The suite in pieces of some length, one after the other or side by side.
SUITE := test-suite-rest test-suite-report test-suite-compare test-suite-rooms
REPORT := report studies pipeline models system
COMPARE := compare fullmodel reduction
ROOMS := simulation export

.PHONY: test
test: setup ## lint, the whole suite, two ranks, BLAS kernels; in CI the wheel stack too
	@echo "lint, the suite under $(or $(KERNEL),the system's BLAS), two ranks; numerical part under $(or $(OTHERS),no other kernel)$(if $(BOTH_STACKS),; a part on the wheel stack)"
	$(if $(BOTH_STACKS),$(IN_CI),$(ALONE))
	@$(if $(BOTH_STACKS),,echo "wheel stack not tested: make test-wheel does it, with Python 3.12 or newer")
	@echo "make test: everything passed"

.PHONY: $(SUITE)
test-suite-rooms: setup .venv-fmi/.ready
	$(call pytest,.venv,$(KERNEL),$(ROOMS:%=tests/%))

test-suite-report: setup
	$(call pytest,.venv,$(KERNEL),$(REPORT:%=tests/%))

test-suite-compare: setup
	$(call pytest,.venv,$(if $(BOTH_STACKS),$(or $(lastword $(BETWEEN)),$(KERNEL)),$(KERNEL)),$(COMPARE:%=tests/%))

test-suite-rest: setup .venv-snakemake/.ready
	$(call pytest,.venv,$(KERNEL),$(patsubst %,--ignore=tests/%,$(ROOMS) $(COMPARE) $(REPORT)))

.PHONY: test-kernels
test-kernels: $(OTHERS:%=test-kernel-%) ## the numerical part under the other BLAS kernels: on two ranks what is for two, else on one

test-kernel-%:
	@$(MAKE) --no-print-directory test-numerical-$* test-ranks-$*

# Under a kernel what is for two ranks runs on two alone: on one it runs under KERNEL.
test-numerical-%: setup
	$(call numerical,.venv,$*, and not mpi)

test-ranks-%: setup
	$(call ranks,.venv,$*,$(OPENMPI),numerical and mpi)

test-mpi-%: setup
	$(call ranks,.venv,$*,$(OPENMPI),mpi)

# Only the tests of workflows/Snakefile want it.
.venv-snakemake/.ready: requirements/snakemake.txt
	@echo "installing Snakemake into .venv-snakemake"
	@/usr/bin/python3 -m venv .venv-snakemake
	@.venv-snakemake/bin/python -m pip install -q --no-compile -r requirements/snakemake.txt
	@touch $@

# Only the tests of FMUs want it.
.venv-fmi/.ready: requirements/fmi.txt
	@echo "installing FMPy into .venv-fmi"
	@/usr/bin/python3 -m venv .venv-fmi
	@.venv-fmi/bin/python -m pip install -q --no-compile -r requirements/fmi.txt
	@touch $@

.PHONY: test-fast
test-fast: setup ## the suite without the slow tests
	$(call pytest,.venv,$(KERNEL),-m "not slow")

# The kernel's extension by each of them, for its own tests; gcc's is the one that the suite runs with.
.PHONY: test-compilers
test-compilers: $(addprefix test-kernel-by-,$(if $(shell command -v clang),clang) zig) ## the kernel's quick tests with its C built by clang (where it is) and by zig

test-kernel-by-clang: export CC := clang
test-kernel-by-zig: export CC := no-compiler
test-kernel-by-%: setup
	@.venv/bin/python setup.py -q build_ext --force --build-lib build/$* --build-temp build/$*-objects
	@PMR_KERNEL=build/$* PATH="$(CURDIR)/.venv/bin:/usr/bin:$$PATH" \
	    python -m pytest -q -m "not slow" -p other_kernel -p no:cacheprovider tests/kernel </dev/null

.PHONY: test-sanitized
test-sanitized: setup ## the kernel's quick tests with its C under AddressSanitizer and UndefinedBehaviorSanitizer
	@CFLAGS="-g -O1 -fno-omit-frame-pointer -fsanitize=address,undefined -fno-sanitize-recover=undefined" \
	    .venv/bin/python setup.py -q build_ext --force --build-lib build/sanitized --build-temp build/sanitized-objects
	@PMR_KERNEL=build/sanitized LD_PRELOAD="$$(cc -print-file-name=libasan.so) $$(cc -print-file-name=libubsan.so)" \
	    ASAN_OPTIONS=detect_leaks=0:abort_on_error=1 PATH="$(CURDIR)/.venv/bin:/usr/bin:$$PATH" \
	    python -m pytest -q -m "not slow" -p other_kernel -p no:cacheprovider tests/kernel </dev/null

.PHONY: test-peers
test-peers: setup ## compare with CalculiX (apt-get install calculix-ccx)
	$(call pytest,.venv,$(KERNEL),-m peers)

.PHONY: test-mpi
test-mpi: setup ## the tests marked mpi, on two ranks
	$(call ranks,.venv,$(KERNEL),$(OPENMPI),mpi)

.PHONY: graph
graph: setup ## rooms of pmr, what each imports, circles
	@PYTHONPATH=. .venv/bin/python tests/rooms.py

.PHONY: lint
lint: setup ## ruff, mypy and the layers
	@.venv/bin/ruff check
	@.venv/bin/ruff format --check
	@.venv/bin/mypy
	@.venv/bin/lint-imports

# The first Python >= 3.12 that can make a venv; a pyenv shim of an inactive version fails and is passed over.
PYTHON312 = $(shell for p in python3.12 python3.13 python3.14 python3 \
    "$${PYENV_ROOT:-$$HOME/.pyenv}"/versions/3.1[2-9]*/bin/python; do \
    "$$p" -c 'import ensurepip, sys; sys.version_info < (3, 12) and sys.exit(1); print(sys.executable)' 2>/dev/null && break; done)

.PHONY: python312
python312:
	@echo "$(PYTHON312)"

.venv-wheel/.ready: $(PINS)
	@[ -n "$(PYTHON312)" ] || { echo "the wheel stack needs Python 3.12 or newer: none found" >&2; exit 1; }
	@echo "installing Python packages into .venv-wheel"
	@"$(PYTHON312)" -m venv .venv-wheel
	$(call pinned,.venv-wheel,wheel)
	@.venv-wheel/bin/python -m pip install -q --no-compile -r requirements/wheel.txt
	@.venv-wheel/bin/python -m pip install -q --no-deps --no-build-isolation -e .
	@touch $@

.PHONY: test-wheel
test-wheel: .venv-wheel/.ready ## all of it on the wheel stack (Python 3.12 or newer)
	$(call both,test-wheel-suite $(OTHERS:%=test-wheel-numerical-%),test-wheel-mpi $(OTHERS:%=test-wheel-ranks-%))

.PHONY: test-wheel-suite
test-wheel-suite: .venv-wheel/.ready
	$(call pytest,.venv-wheel,$(KERNEL))

.PHONY: test-wheel-mpi
test-wheel-mpi: .venv-wheel/.ready
	$(call ranks,.venv-wheel,$(KERNEL),mpirun,mpi)

test-wheel-numerical-%: .venv-wheel/.ready
	$(call numerical,.venv-wheel,$*)

test-wheel-ranks-%: .venv-wheel/.ready
	$(call ranks,.venv-wheel,$*,mpirun,numerical and mpi)

.PHONY: test-wheel-part
test-wheel-part: .venv-wheel/.ready
	$(call pytest,.venv-wheel,$(LAST_KERNEL),-m stack)

.PHONY: test-wheel-part-mpi
test-wheel-part-mpi: .venv-wheel/.ready
	$(call ranks,.venv-wheel,$(KERNEL),mpirun,mpi and first and not slow)

.PHONY: schemas
schemas: setup ## write what editors complete and check workflows from
	@for kind in scene study; do .venv/bin/pmr schema $$kind >workflows/schemas/$$kind.json || exit 1; done

.PHONY: clean
clean: ## remove what make and the tests made, the venvs too
	rm -rf docs/_build docs/gallery docs/_static/report_*.html .venv .venv-wheel .venv-snakemake .venv-fmi .venv-release .snakemake build dist reports/paper reports/benchmarks pmr/kernel/_native* .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
	find pmr tests -name __pycache__ -prune -exec rm -rf {} +
