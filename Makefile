# make demo | test | bench | lint: each sets up what it needs in .venv by itself, with pinned versions, and says what it does.
PYTHON ?= python3
BIN := .venv/bin
FUZZ_SECONDS ?= 180
RIG ?= full
LOCK := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-annotate \
	--excludes requirements/excluded.txt --custom-compile-command "make lock"

.PHONY: demo test test-rig deb release bench lint fuzz docs sbom lock model-sums demo-drive develop clean
.DEFAULT_GOAL := demo

demo: .venv/.service
	@echo "== demo: the shipped drive over a CAN bus, through the service, over Zenoh, to a subscriber in another process"
	$(BIN)/echogrid demo --out out/demo

# Four at a time, on two cores as well: tests wait for programs and sockets. Bytecode is written as it is needed, whatever the environment
# says: the installation compiles none, and tests start hundreds of programs.
test: .venv/.develop
	@echo "== test: service and training package; warnings are errors"
	PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest --numprocesses=4 --dist=loadfile

test-rig: .venv/.develop deb
	@echo "== test-rig: the service on real CAN interfaces, its package under a real systemd; in a guest, or on this machine with RIG=here"
	RIG=$(RIG) tests/rig/set-up
	RIG=$(RIG) $(BIN)/python -m pytest -s tests/rig

deb: .venv/.service
	@echo "== deb: a Debian package for this machine's distribution, in dist (deploy/README.md)"
	deploy/debian/build $(BIN)/pip

release: deb sbom
	@echo "== release: sdist, wheels, requirements, SBOM, changes and checksums beside the Debian package, in dist (CONTRIBUTING.md)"
	$(BIN)/python -m release.build --sbom build/sbom.json

bench: .venv/.develop
	@echo "== bench: ratios against named references, in one run"
	$(BIN)/python -m tests.bench
	$(BIN)/python -m tests.bench.clients

lint: .venv/.develop
	@echo "== lint: ruff, mypy (strict for the service), and the arrows between rooms"
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy service training
	$(BIN)/mypy --strict release
	$(BIN)/lint-imports

fuzz: .venv/.develop
	@echo "== fuzz: properties with new examples; then every target for $(FUZZ_SECONDS) s, guided by coverage; findings lie in out/fuzz (docs/security.md)"
	$(BIN)/python -m pytest -m hypothesis --hypothesis-profile=roaming --numprocesses=auto --maxprocesses=4
	$(BIN)/python -m tests.fuzz --seconds $(FUZZ_SECONDS)

docs: .venv/.develop
	@echo "== docs: these documents as a site, in build/docs; what is broken, links among it, fails"
	$(BIN)/python -m sphinx --quiet --fail-on-warning --builder html --conf-dir docs --doctree-dir build/doctrees . build/docs

sbom: build/tools
	@echo "== sbom: what the service is made of, as CycloneDX, in build/sbom.json"
	@mkdir -p build/sbom
	sed "s/^dynamic = .*/version = \"$$($(PYTHON) release/version.py)\"/" pyproject.toml > build/sbom/pyproject.toml
	build/tools/bin/cyclonedx-py requirements requirements/service.txt --pyproject build/sbom/pyproject.toml --mc-type application \
		--output-reproducible --of JSON -o build/sbom.json

# Pins what pyproject.toml, training/pyproject.toml and requirements/*.in ask for. A pin stays where it still fits: take its line out, or
# the file away, to have it renewed.
lock: .venv/.service
	@echo "== lock: requirements/*.txt with hashes"
	$(LOCK) pyproject.toml --extra terminal --extra metrics --extra mcap --extra view -o requirements/service.txt
	$(LOCK) pyproject.toml --all-extras training/pyproject.toml requirements/develop.in -c requirements/service.txt -o requirements/develop.txt
	$(LOCK) requirements/build.in -c requirements/develop.txt -o requirements/build.txt
	$(LOCK) requirements/tools.in -c requirements/develop.txt -o requirements/tools.txt

# After a shipped model was exchanged.
model-sums:
	cd service/echogrid/models && sha256sum *.onnx > SHA256SUMS

# Generates the demo drive again; the same seed gives the same bytes.
demo-drive: .venv/.develop
	$(BIN)/echogrid-train demo --out service/echogrid/demo_drive --force

develop: .venv/.develop

.venv/.python:
	@echo "== a virtual environment in .venv"
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13) and "echogrid needs Python 3.11 to 3.13, found " + sys.version.split()[0] + "; give one with: make PYTHON=python3.11")'
	$(PYTHON) -m venv .venv
	@touch $@

.venv/.service: .venv/.python requirements/service.txt requirements/build.txt pyproject.toml hatch_build.py release/version.py service/echogrid/core/kernels/compiled.c $(wildcard service/echogrid/core/kernels/*.h)
	@echo "== the service and what it needs"
	$(BIN)/pip install --quiet --no-compile --require-hashes -r requirements/service.txt -r requirements/build.txt
	$(BIN)/pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@

.venv/.develop: .venv/.service requirements/develop.txt requirements/torch.txt training/pyproject.toml
	@echo "== the training package, tests and tools (PyTorch among them: this takes a few minutes)"
	$(BIN)/uv pip install --quiet --python $(BIN)/python --require-hashes -r requirements/develop.txt
	$(BIN)/pip install --quiet --no-compile -r requirements/torch.txt
	$(BIN)/pip install --quiet --no-deps --no-build-isolation --editable training
	@touch $@

build/tools: requirements/tools.txt
	@echo "== tools of maintainers, in build/tools"
	$(PYTHON) -m venv --clear $@
	$@/bin/pip install --quiet --require-hashes -r requirements/tools.txt
	@touch $@

clean:
	rm -rf .venv out build dist
