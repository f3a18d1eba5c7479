# make demo   set up, run the demo campaign; its last line says where the report is
# make test   set up, check style, types and architecture, run the tests and a small campaign from end to end
# Both need python3 (3.11 or later, with venv) and make, nothing else. Without a network: make wheelhouse where there is
# one, carry the folder over, then make demo WHEELS=folder.

PYTHON ?= python3
VENV   ?= .venv
JOBS   ?= $(shell nproc 2>/dev/null || echo 2)
WHEELS ?=

bin := $(VENV)/bin
pip := $(bin)/python -m pip --disable-pip-version-check -qq
from_wheels := $(if $(WHEELS),--no-index --find-links "$(WHEELS)")
wheels_needed := pip 'hatchling>=1.27,<2' editables

.DELETE_ON_ERROR:
.PHONY: help demo test quick lint unit smoke slow browser bounds lowest test-lowest bench docs study-conae study-dlr study-drdc study-gains recorded test-s3 trade wheelhouse clean

help:
	@sed -n 's/^# //p' Makefile | head -4
	@echo 'also: make slow | browser | bounds | lowest | bench | docs | study-conae | study-dlr | study-drdc | study-gains | recorded | test-s3 | wheelhouse | clean'

# A stamp stands for an installation and is older than pyproject.toml when that must be repeated.
$(bin)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "$(PYTHON) is missing or older than 3.11 (another one: make PYTHON=python3.12 ...)" >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
	    { echo "$(PYTHON) has no venv: apt-get install python3-venv" >&2; exit 1; }
	@echo "setting up $(VENV)"
	@$(PYTHON) -m venv "$(VENV)"

$(VENV)/.installed: pyproject.toml | $(bin)/python
	@echo "installing lvnav-trade$(if $(WHEELS), from $(WHEELS))"
	@$(pip) install $(from_wheels) --editable .
	@touch $@

$(VENV)/.installed-%: $(VENV)/.installed
	@echo "installing what lvnav-trade[$*] needs$(if $(WHEELS), from $(WHEELS))"
	@$(pip) install $(from_wheels) --editable '.[$*]'
	@touch $@

# "violated" (1) and "undecided" (3) are answers of a campaign, not failures of the tool.
define run
	@$(bin)/lvnav-trade run campaigns/$(1).yaml --fresh --jobs $(JOBS); code=$$?; \
	case $$code in 0|1|3) ;; *) echo "campaigns/$(1).yaml: lvnav-trade ended with exit code $$code" >&2; exit $$code;; esac
endef

# Worse than what is kept is a failure; undecided (3) is not, eight runs may be too few for a change that is meant.
define compare
	@$(bin)/lvnav-trade compare $(1) $(2); code=$$?; \
	case $$code in 0|3) ;; *) echo "$(2): worse than $(1), or not to be compared with it ($$code)" >&2; exit 1;; esac
endef

demo: $(VENV)/.installed
	$(call run,demo)
	@test -s results/demo/report.html || { echo "the demo campaign left no report" >&2; exit 1; }

test: unit
	@echo "all tests passed"

# Style and types are checked while the small campaign runs. The other tests wait for it: it compiles kernels that most
# of them use, which their processes would each compile again.
quick: $(VENV)/.installed-test
	@$(MAKE) --no-print-directory -j2 lint smoke

lint: $(VENV)/.installed-test
	@$(bin)/ruff check --quiet
	@$(bin)/ruff format --check --quiet || { $(bin)/ruff format --check; exit 1; }
	@$(bin)/mypy --no-error-summary
	@$(bin)/lint-imports --no-logo > "$(VENV)/imports.log" 2>&1 || { cat "$(VENV)/imports.log"; exit 1; }
	@echo "style, types and architecture: good"

smoke: $(VENV)/.installed-test
	$(call run,smoke)
	@test -s results/smoke/report.html || { echo "the small campaign left no report" >&2; exit 1; }
	$(call compare,tests/baseline/smoke,results/smoke)
	@echo "a small campaign from end to end: good"

unit: quick
	@$(bin)/python -m tests.by_room $(JOBS)

# The report in a browser and on paper, and the manual; needs chromium and poppler-utils (apt-get install chromium poppler-utils).
browser: $(VENV)/.installed-test
	@command -v chromium >/dev/null && command -v pdftotext >/dev/null || \
	    { echo "chromium or pdftotext is missing: apt-get install chromium poppler-utils" >&2; exit 1; }
	@$(bin)/python -m pytest -m "slow or not slow" tests/report/test_browser.py tests/architecture/test_site.py

slow: $(VENV)/.installed-test
	@$(bin)/python -m pytest -m slow

# Seeded mutants of files of data, campaigns and results, as many as docs/hardening.md states.
fuzz: $(VENV)/.installed-test
	@$(bin)/python -m tests.fuzzing data 10000
	@$(bin)/python -m tests.fuzzing results 1000
	@$(bin)/python -m tests.fuzzing campaigns 3000

# Small campaigns of every filter, delay, sensor and fault, with each index of a compiled array checked.
bounds: $(VENV)/.installed-test
	@$(bin)/python -m pytest -m slow tests/both_engines/test_bounds.py

# The tests with the lowest versions that pyproject.toml allows, in a folder of their own. All of them have wheels for
# Python 3.11: make lowest PYTHON=python3.11
lowest test-lowest: | $(bin)/python
	@test -x "$(VENV)-lowest/bin/python" || $(PYTHON) -m venv "$(VENV)-lowest"
	@$(bin)/python tests/lowest.py > "$(VENV)-lowest/constraints.txt"
	@"$(VENV)-lowest/bin/python" -m pip --disable-pip-version-check -qq install $(from_wheels) \
	    --constraint "$(VENV)-lowest/constraints.txt" --editable '.[test]'
	@NUMBA_CACHE_DIR="$(CURDIR)/$(VENV)-lowest/kernels" "$(VENV)-lowest/bin/python" -m tests.by_room $(JOBS)

# The manual, in site/; needs no network once installed.
docs: $(VENV)/.installed-docs
	@rm -rf site && $(bin)/python docs/generate.py site
	@echo "the manual: site/index.html"

# What a target installs beyond the tests' packages goes into a folder of its own: no other target sees it.
$(VENV)-%/.installed: pyproject.toml | $(bin)/python
	@test -x "$(VENV)-$*/bin/python" || $(PYTHON) -m venv "$(VENV)-$*"
	@echo "installing lvnav-trade[$(extras_$*)] into $(VENV)-$*$(if $(WHEELS), from $(WHEELS))"
	@"$(VENV)-$*/bin/python" -m pip --disable-pip-version-check -qq install $(from_wheels) \
	    --editable '.[$(extras_$*)]' $(more_$*)
	@touch $@

extras_bench := bench
bench: $(VENV)-bench/.installed
	@OPENBLAS_NUM_THREADS=1 "$(VENV)-bench/bin/python" -m benchmarks.run  # as in worker processes

# A published study again, every campaign of its folder: an hour or so; killed, the same command goes on.
study-conae study-dlr study-drdc study-gains: study-%: $(VENV)/.installed
	@$(bin)/python campaigns/$*/study.py --keep reports/$* --jobs $(JOBS)

# Results on a server of S3 on this machine (the packages of both are installed for it).
extras_s3 := test
more_s3 := 's3fs>=2024.2,<2028' 'moto[server]>=5,<6'
test-s3: $(VENV)-s3/.installed
	@"$(VENV)-s3/bin/python" -m pytest -q tests/results/tables/test_remote.py

# Recorded sets of others, from the folder that holds them: SETS=... make recorded
recorded: $(VENV)/.installed
	@mkdir -p build/recorded && $(bin)/python -m tests.recorded_sets "$(SETS)" build/recorded
	@$(bin)/lvnav-trade process-log campaigns/recorded/walk.yaml build/recorded/walk_log.yaml -o reports/recorded/walk
	@$(bin)/lvnav-trade process-log campaigns/recorded/drive.yaml build/recorded/drive_log.yaml -o reports/recorded/drive \
	    --outage '15 s' --outage '30 s' --first 10 --every 1
	@$(bin)/lvnav-trade process-log campaigns/recorded/drive_tight.yaml build/recorded/drive_log.yaml \
	    -o reports/recorded/drive_tight --outage '15 s' --outage '30 s' --first 10 --every 1 \
	    --set "base.constellation={kind: rinex, rinex: $(CURDIR)/build/recorded/drive.nav}"

# Searches over designs: their pages in reports/trade.
trade: $(VENV)/.installed
	@$(bin)/lvnav-trade solve campaigns/trade/heading_needed.yaml --out reports/trade/heading_needed --jobs $(JOBS)
	@$(bin)/lvnav-trade indices campaigns/trade/sobol.yaml --out reports/trade/sobol --jobs $(JOBS)
	@$(bin)/lvnav-trade tune campaigns/trade/tune.yaml --out reports/trade/tune --jobs $(JOBS)
	$(call run,trade/find_imu)
	$(call run,trade/bias_by_latency)
	$(call run,trade/space)
	@$(bin)/lvnav-trade report results/find_imu --keep reports/trade/find_imu
	@$(bin)/lvnav-trade report results/bias_by_latency --keep reports/trade/bias_by_latency
	@$(bin)/lvnav-trade report results/space --keep reports/trade/space --no-tables

wheelhouse: pyproject.toml | $(bin)/python
	@$(pip) wheel --wheel-dir wheelhouse '.[test]' $(wheels_needed)
	@echo "wheelhouse/ holds $$(ls wheelhouse | wc -l) wheels, $$(du -sh wheelhouse | cut -f1)"

clean:
	@rm -rf "$(VENV)" "$(VENV)-lowest" "$(VENV)-bench" "$(VENV)-s3" build dist results wheelhouse site .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
