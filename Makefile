# Two commands matter: `make demo` and `make test`. Each makes .venv and installs what it needs.  Bytecode
# is kept as it is imported, whatever the environment says: compiling all packages takes longer than the demo.
PYTHON ?= python3
BIN := .venv/bin
UV := 0.13.8
INSTALL = $(BIN)/python -m uv pip install --quiet --python $(BIN)/python --constraint constraints.txt

.PHONY: demo test test-long test-pythons lint docs bench coverage fleet mutate fuzz crash soak display-check pages-check pictures release-check test-service test-socketcan constraints clean

demo: .venv/demo
	PYTHONDONTWRITEBYTECODE= $(BIN)/bumpbench demo

# One worker more than processors, as some tests wait for a bus or a terminal.  One thread of BLAS for
# each: two that wait for each other take twice the time.
test: .venv/test
	PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 \
	    $(BIN)/python -m pytest --quiet --dist worksteal \
	    --numprocesses $$(($(shell getconf _NPROCESSORS_ONLN) + 1))

# The long forms of what the tests show in short: whole campaigns by hand, both buses, every stress.
test-long: .venv/test
	PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest --quiet -m long

# Every promised Python that is here or can be had, and the lowest stated versions: some 10 minutes.
test-pythons: .venv/test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.house.pythons

lint: .venv/test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/vulture

# The reference of the public API as pages to browse, in build/docs/; needs no network.
docs: .venv/test
	$(BIN)/python -m sphinx --fresh-env --fail-on-warning --keep-going --quiet docs/reference build/docs

bench: .venv/bench
	$(BIN)/python -m tests.benchmarks

# Do the intervals hold the truth?  Some 3 s a campaign; CAR=granada-rough, with friction: 20 s.
coverage: .venv/test
	$(BIN)/python -m tests.flow.coverage $(or $(CAMPAIGNS),100) $(CAR)

# How often are real cars right?  Two fleets of plausible ones: of the fit's own force laws, and of others
# (stops, dampers, friction, springs, tyres).  A minute a car.
fleet: .venv/test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.simulated.fleet_study $(or $(CARS),20)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.simulated.other_laws $(or $(CARS),20)

# Small faults in the sources (cosmic-ray), each against the tests that pass through its line: lists those
# that no test finds.  PATHS: files; without it all packages.
mutate: .venv/test
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.house.mutate --count $(or $(N),200) --seed $(or $(SEED),1) $(PATHS)

# Mutated databases, session files, logs and files of channels: no traceback, no hang, bounded memory.
fuzz: .venv/test
	$(BIN)/python -m pytest -q -m long tests/dbc
	$(BIN)/python -m tests.daq.test_mutations $(or $(FILES),2000)

# Kills, crash images, failing writes, full disks: no acknowledged frame may be lost.  The parts run
# side by side, one more than processors.
crash: .venv/test
	$(BIN)/python -m tests.daq.crash

# Ten million frames through the whole recorder: flat memory, no frame lost.
soak: .venv/test
	$(BIN)/python -m tests.daq.test_soak $(or $(FRAMES),10000000)

# A whole simulated campaign on the display, in a Chromium of this machine: words, sizes, contrast,
# a cut line, load, axe; pictures in build/display/.  About three minutes.
display-check: .venv/test
	$(BIN)/python -m tests.flow.display_campaign

# Report, comparison and batch page under axe in a Chromium of this machine: light, dark, print, desk
# and phone; pictures in build/pages/.  Half a minute.
pages-check: .venv/test
	$(BIN)/python -m tests.flow.pages_check

# The README's two pictures, drawn anew in a Chromium of this machine.  One minute.
pictures: .venv/test
	$(BIN)/python -m tests.flow.pictures

# Build wheel and sdist, install them into empty environments with each extra, and try them.
release-check: .venv/test
	$(BIN)/python -m tests.house.release

# The unit under a real systemd, from boot to clean stop, in a guest; needs qemu-system-x86_64.
test-service: .venv/test
	$(BIN)/python -m tests.service.guest

# Real SocketCAN: vcan and emulated adapters in a guest; needs qemu-system-x86_64.
test-socketcan: .venv/test
	$(BIN)/python -m tests.socketcan.guest

constraints: .venv/test
	$(BIN)/python -m uv pip compile --quiet --universal --python-version 3.11 --upgrade \
	    --no-header --no-annotate --all-extras pyproject.toml --output-file constraints.txt

clean:
	rm -rf .venv build *.egg-info

.venv/python: Makefile
	$(PYTHON) -m venv --clear .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv==$(UV)
	touch $@

.venv/demo: .venv/python pyproject.toml constraints.txt
	$(INSTALL) --editable '.[web]'
	touch $@

.venv/test: .venv/python pyproject.toml constraints.txt
	$(INSTALL) --editable '.[test]'
	touch $@ .venv/demo

.venv/bench: .venv/test
	$(INSTALL) --editable '.[bench,mf4,test]'
	touch $@
