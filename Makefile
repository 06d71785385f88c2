# Everything runs in a virtual environment that is made on first use. PYTHON: 3.11 or newer.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
# Without compiled modules, which pip leaves out and the first import writes, each process that the
# tests start compiles what it imports: 8 s of processor time instead of 2 s for `faultgen isolate`
unexport PYTHONDONTWRITEBYTECODE

.PHONY: install lock demo docs test fast-tests test-slow fuzz lint mutation benchmark pictures clean

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

# Hours: see "Mutation run" in docs/methods.md. Name modules to run a part: MODULES="faultgen/dataset/wear.py"
mutation: install
	$(BIN)/python -m benchmarks.mutation.run $(MODULES) --save benchmarks/results/mutation.json

benchmark: install
	$(BIN)/python -m benchmarks.speed.speed --save benchmarks/results/speed.json
	$(BIN)/python -m benchmarks.speed.peers --save benchmarks/results/peers.json
	$(BIN)/python -m benchmarks.speed.growth --save benchmarks/results/growth.json
	$(BIN)/python -m benchmarks.speed.signature_speed --save benchmarks/results/signature_speed.json
	$(BIN)/python benchmarks/speed_page.py
	$(BIN)/python -m benchmarks.speed.transfer_entropy

pictures: install
	$(BIN)/python docs/pictures.py
	$(BIN)/python -m benchmarks.pages.effect_signatures

clean:
	rm -rf $(VENV) demo-out build *.egg-info
