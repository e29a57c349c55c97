# `make reproduce` and `make test` set everything up in .venv on the first call; a second call installs nothing.
#
#   make TORCH=torch==2.13.0 test     on a machine with CUDA: any requirement (and options) that pip understands
#   make PYTHON=python3.12 test       another interpreter, 3.11 or newer

PYTHON ?= $(shell command -v python3.11 || command -v python3)
TORCH ?=
PROFILE ?= quick

VENV := .venv
BIN := $(VENV)/bin
# A process on each core; one that has run out of tests takes some from another.
PYTEST := $(BIN)/pytest -n auto --maxprocesses 8 --dist worksteal
STAMP := $(VENV)/.installed
CPU_WHEELS := https://download.pytorch.org/whl/cpu

export OMP_NUM_THREADS ?= 1
export WANDB_MODE ?= offline

.PHONY: help install reproduce test test-all lint audit types format docs picture architecture clean

help:
	@echo 'make reproduce   identify the parameters of every scene and print them beside the truth'
	@echo 'make test        run the tests (make test-all: the slow ones too)'
	@echo 'make lint types  check style and types; make format mends the style'
	@echo 'make audit       look the pinned packages up among known faults'
	@echo 'make docs        write the reference of the Python interface into site/'
	@echo 'make picture     draw the picture of README.md from two runs (make architecture: of the packages)'
	@echo 'make install     only create .venv; make clean removes it'

reproduce: $(STAMP)
	$(BIN)/physid reproduce --profile $(PROFILE) --at-once 2

test: $(STAMP)
	$(PYTEST) -m 'not slow'

test-all: $(STAMP)
	$(PYTEST)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/bandit --quiet --recursive -c pyproject.toml src

# Known faults of the pinned packages; needs the net, and pip-audit, which is installed beside physid for the moment.
audit: $(STAMP)
	$(BIN)/python -m venv $(VENV)/audit
	$(VENV)/audit/bin/pip install --quiet pip-audit
	$(VENV)/audit/bin/pip-audit --requirement constraints-cpu.txt --no-deps --disable-pip

types: $(STAMP)
	$(BIN)/mypy

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(STAMP)
	$(BIN)/pdoc physid --docformat google --output-directory site

picture: $(STAMP)
	$(BIN)/python docs/pictures/overview.py

architecture: $(STAMP)
	$(BIN)/python docs/pictures/architecture.py

install: $(STAMP)

# torch comes first and alone: if pip's own sources lack the CPU build, only this one package is looked up in PyTorch's
# index, and every other package keeps coming from where pip is configured to look.
$(STAMP): pyproject.toml constraints-cpu.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "physid needs Python 3.11 or newer: make PYTHON=...")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
ifeq ($(strip $(TORCH)),)
	@echo 'installing torch into $(VENV), about one minute'
	cp constraints-cpu.txt $(VENV)/constraints.txt
	$(BIN)/pip install --quiet --no-deps -c $(VENV)/constraints.txt torch 2>$(VENV)/torch.log || \
	    { echo 'pip finds no CPU build of torch: adding $(CPU_WHEELS)'; \
	      $(BIN)/pip install --no-deps -c $(VENV)/constraints.txt --extra-index-url $(CPU_WHEELS) torch; }
else
	grep -v '^torch==' constraints-cpu.txt > $(VENV)/constraints.txt
	$(BIN)/pip install $(TORCH)
endif
	@echo 'installing the other packages, about two minutes'
	$(BIN)/pip install --quiet -c $(VENV)/constraints.txt -e '.[dev]'
	touch $@

clean:
	rm -rf $(VENV)
