# Two commands for everyone: `make demo` and `make test`. They need Python 3.11 and make, nothing installed by hand.

PYTHON ?= python3.11
ifeq (, $(shell command -v $(PYTHON) 2>/dev/null))
PYTHON := python3
endif
BIN := .venv/bin
READY := .venv/.ready
# Only files with such tests are read, which takes a while for all of them.
REALTIME = $(shell grep -rlE --include='test_*.py' 'mark\.realtime' tests)
SLOW = $(shell grep -rlE --include='test_*.py' 'mark\.slow' tests)
# Tests start many processes: what Python compiles is kept, also where the surroundings forbid it.
unexport PYTHONDONTWRITEBYTECODE

.NOTPARALLEL:
.PHONY: demo test fast clock slow sweep style check model docs pictures notebooks dist licences release-check recording three \
	webcam lerobot format

demo: $(READY)  ## high fives in the browser, and a simulated session: report, film and recording in out/
	$(BIN)/highfive demo

test: fast clock  ## fast tests

fast: $(READY)  # those of them that do not go by the clock
	$(BIN)/python tests/compile_ahead.py
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder -m "not slow and not realtime"

clock: $(READY)  # those that do, with nothing beside them
	$(BIN)/python -m pytest -m "realtime and not slow" $(REALTIME)

slow: $(READY)  ## tests that take long; PART=2/5 for those of every commit and a fifth of the others, as CI runs them
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder --durations 12 -m "slow and not sweep and not realtime" $(PART:%=--part %) $(SLOW)
	$(BIN)/python -m pytest -m "slow and realtime and not sweep" $(REALTIME)

sweep: $(READY)  ## of what CI tries a part, before a release: the other slow cases, a thousand schedules of faults, an arm at each cell, damaged files (an hour)
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder --durations 12 -m "sweep and not realtime" $(SLOW)
	$(BIN)/python -m pytest -m "sweep and realtime" $(REALTIME)
	$(BIN)/highfive bench faults --seeds 1000
	$(BIN)/highfive bench arms --arms 9
	$(BIN)/highfive bench fuzz --inputs 5000 --jobs 2

style: $(READY)  ## style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

check: style test  ## style, types and fast tests

model: $(READY)  ## the default model again, from nothing
	$(BIN)/highfive capture --repetitions 13 --test-repetitions 1 --seed 0 --out out/captured --overwrite
	$(BIN)/highfive train out/captured --seed 0 --out model/default.safetensors --overwrite

docs: $(READY)  ## the documentation site, in out/site
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@echo "open out/site/index.html"

pictures: $(READY)  ## the pictures of the documentation again, from runs of today; needs OpenGL and Chromium, half an hour
	for picture in front page experiment study states; do \
	  $(BIN)/python docs/make_$${picture}_picture*.py || exit 1; done
	for arm in :vx300s _wx250s:wx250s _openmanipulator_x:openmanipulator_x _koch_v1_1:koch_v1_1; do \
	  $(BIN)/highfive rig reach --arm $${arm#*:} --picture docs/arm_reach$${arm%:*}.png --overwrite || exit 1; done
	$(BIN)/highfive bench contact --player twin --picture docs/contact_map.png --overwrite

dist: $(READY)  ## wheels and source distributions of the last commit, in dist/; the same commit gives the same bytes
	$(BIN)/python packaging/dist.py --check

licences: $(READY)  ## the tables of docs/licences.md again
	$(BIN)/python packaging/licences.py

release-check: $(READY)  ## what is in dist/, tried in new environments of each Python here; takes long
	$(BIN)/python packaging/try_release.py

notebooks: $(READY)  ## the notebooks of examples/ again, with what comes out
	$(BIN)/python docs/make_notebooks.py

recording: $(READY)  ## the short recording of `highfive view` again
	$(BIN)/python docs/make_shipped_recording.py

three:  ## three.js of the page again; needs Node
	cd docs/three && npm install --no-audit --no-fund --no-package-lock && npm run build

webcam: $(READY)  ## the nets of `highfive simulate --source webcam`; needs npm
	$(BIN)/python packaging/webcam/fetch.py
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps ./packaging/webcam

lerobot: $(READY)  ## our arm and data sets in lerobot itself, in an environment of its own (9 GB)
	test -x .venv-lerobot/bin/python || $(PYTHON) -m venv .venv-lerobot
	.venv-lerobot/bin/python -m pip install --quiet --disable-pip-version-check ./packaging/lerobot
	LEROBOT_PYTHON=.venv-lerobot/bin/python $(BIN)/python -m pytest tests/packaging

format: $(READY)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "High Five needs Python 3.11 or newer; this is " + sys.version.split()[0] + ". Give another with: make PYTHON=python3.11 …")'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	touch $@
