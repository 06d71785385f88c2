# Everything runs in a virtual environment that is made on first use. PYTHON: 3.11 or newer.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
# Without compiled modules, which pip leaves out and the first import writes, each process that the
# tests start compiles what it imports: 8 s of processor time instead of 2 s for `faultgen isolate`
unexport PYTHONDONTWRITEBYTECODE

.PHONY: install lock demo docs test fast-tests test-slow fuzz lint mutation results benchmark pictures clean

install: $(VENV)/installed

$(VENV)/installed: pyproject.toml requirements.lock
	$(PYTHON) -c 'import sys; sys.exit("faultgen needs Python 3.11 or newer") if sys.version_info < (3, 11) else 0'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@

# The newest versions that fit together, with their checksums, for all versions of Python
lock: install
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile pyproject.toml --extra dev --universal --python-version 3.11 \
		--generate-hashes --no-header --quiet --upgrade --output-file requirements.lock

demo: install
	$(BIN)/faultgen demo --out demo-out

docs: install
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo 'build/site/index.html; with search: $(BIN)/python -m http.server -d build/site'

# The checker of types uses one processor only, so it runs beside the tests
test: install
	$(MAKE) --jobs=2 lint fast-tests

fast-tests: install
	$(BIN)/python -m pytest -n auto --dist worksteal -m 'not slow'

test-slow: install
	$(BIN)/python -m pytest -n auto -m slow

fuzz: install
	FAULTGEN_FUZZ=2000 $(BIN)/python -m pytest -n auto tests/project/test_fuzz.py

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	# the checker sees the folders as they are installed: analysis and robots within faultgen
	rm -rf build/typed && mkdir -p build/typed/faultgen
	for part in faultgen/*; do ln -s ../../../$$part build/typed/$$part; done
	ln -s ../../../analysis ../../../robots build/typed/faultgen/
	$(BIN)/mypy

# Hours: see "Mutation run" in benchmarks/README.md. Name modules to run a part: MODULES="faultgen/dataset/wear.py"
mutation: install
	$(BIN)/python -m benchmarks.mutation.run $(MODULES) --save benchmarks/results/mutation.json

# Everything that the tables of the documentation show: several hours. Name parts to make only these:
# PARTS="growth peers"; `python -m benchmarks.results --list` prints them with their times
results: install
	$(BIN)/python -m benchmarks.results $(addprefix --only ,$(PARTS))

SPEED = speed peers growth signature_speed
benchmark: install
	$(BIN)/python -m benchmarks.results --again $(addprefix --only ,$(SPEED))
	$(BIN)/python -m benchmarks.speed.transfer_entropy

pictures: install
	$(BIN)/python docs/pictures.py
	$(BIN)/python -m benchmarks.pages.effect_signatures

clean:
	rm -rf $(VENV) demo-out build *.egg-info
