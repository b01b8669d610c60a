# Two commands matter: `make demo` and `make test`. Both make what they need.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/pip --disable-pip-version-check

.PHONY: demo test browser library protocols lint format evaluate bench soak faults networks fuzz docs pictures reference wheel-test clean

demo: $(VENV)/.runtime
	$(BIN)/sumo-adas run highway --out out/demo --seed 1

test: $(VENV)/.dev
	$(BIN)/python -m pytest -n 2

# The report page in Debian's chromium; `make test` runs these too where there is one.
browser: $(VENV)/.dev
	$(BIN)/python -m pytest tests/analysis/test_report_browser.py -rs
	$(BIN)/python benchmarks/report_page.py --out out/report_page

library: $(VENV)/.dev
	$(BIN)/python -m pytest -n 2 scenarios

protocols: $(VENV)/.runtime
	$(BIN)/sumo-adas protocol all --out out/protocols

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(VENV)/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

evaluate: $(VENV)/.runtime
	$(BIN)/sumo-adas evaluate --out out/evaluation

bench: $(VENV)/.bench
	$(BIN)/python benchmarks/speed.py --cold --out out/benchmark.json
	$(BIN)/python benchmarks/search_against_others.py
	$(BIN)/python benchmarks/lanes_against_hough.py
	$(BIN)/python benchmarks/radar_filters.py
	$(BIN)/python benchmarks/rendering_against_opencv.py
	$(BIN)/python benchmarks/coupling_against_traci.py

soak: $(VENV)/.runtime
	$(BIN)/python benchmarks/soak.py --duration 3600 --out out/soak

faults: $(VENV)/.dev
	$(BIN)/python benchmarks/faults.py --kills 50

# The site, in out/site; nothing is fetched. Read it with: python -m http.server -d out/site
docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

# The pages that are made from the code; tests compare them.
reference: $(VENV)/.runtime
	$(BIN)/python -m analysis.table_reference > docs/tables.md
	$(BIN)/python -m analysis.settings_reference > docs/settings.md
	$(BIN)/python -m analysis.command_reference > docs/commands.md

pictures: $(VENV)/.runtime
	$(BIN)/python docs/site/pictures.py

wheel-test: $(VENV)/.dev
	.ci/wheel $(PYTHON)

networks: $(VENV)/.runtime
	$(BIN)/python -m benchmarks.networks

fuzz: $(VENV)/.dev
	$(BIN)/python -m benchmarks.fuzz --inputs 100000 --out out/fuzz

clean:
	rm -rf out build dist *.egg-info
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +

# the stamp comes last: an interrupted installation is begun anew
$(VENV)/.made:
	$(PYTHON) -m venv --clear $(VENV)
	touch $@

$(VENV)/.runtime: pyproject.toml constraints.txt | $(VENV)/.made
	$(PIP) install --quiet --constraint constraints.txt --editable .
	touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(VENV)/.made
	$(PIP) install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $@ $(VENV)/.runtime

$(VENV)/.bench: pyproject.toml constraints.txt | $(VENV)/.made
	$(PIP) install --quiet --constraint constraints.txt --editable '.[bench]'
	touch $@ $(VENV)/.runtime

$(VENV)/.docs: pyproject.toml constraints.txt | $(VENV)/.made
	$(PIP) install --quiet --constraint constraints.txt --editable '.[docs]'
	touch $@ $(VENV)/.runtime
