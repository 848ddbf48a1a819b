# The commands that README.md names; .ci/run calls lint and test.
.PHONY: demo station haptics viewer test test-viewer test-python test-unity unity-protocol images screenshots figures docs imports reference test-all same-bits lint lint-rust lint-clients tools publish-protocol verify verify-page experiment extremes extremes-page strokes strokes-page dice bench performance compare peers load load-page fuzz fuzz-guided lives worlds soak deny advisories deb sbom image-archives wheel release-files checksums release-notes

# Folder of scanned meshes for some of the tests and for `performance`, which leave them out where it is empty.
TEST_SHARED ?= $(abspath $(wildcard ../shared))
export TEST_SHARED

DEMO_OUT ?= out/demo
DEMO_ADDRESS ?= 127.0.0.1:50051

# Many tests wait for clocks and sockets: two at a time for each processor.
RUST_TEST_THREADS ?= $(shell echo $$((2 * $$(nproc))))
export RUST_TEST_THREADS

NPM := $(shell command -v npm)

# What all targets build, optimised and as `make test` has it: for other packages Cargo chooses other features, and
# compiles nearly all of them anew.
RELEASE := cargo build --release --bin kerf-server --bin kerf-load --bin kerf-station
PROGRAMS := cargo test --workspace --no-run

# Starts a server, cuts the liver twice through it, leaves plots and the surface. On a terminal the server then goes on
# for whoever opens the page that it names; else it stops.
demo: viewer
	$(RELEASE)
	@target/release/kerf-server serve --listen $(DEMO_ADDRESS) --log-filter warn & server=$$!; \
	trap 'kill $$server 2>/dev/null; wait $$server' EXIT; trap 'exit 0' INT; \
	target/release/kerf-load --server http://$(DEMO_ADDRESS) --scene liver --step-rates 1000,500,250,125,60 --levels 2,3 \
		--strokes 2 --jitter 0 --depth 0.05 --speed 0.05 --wait-for-server 10 --out $(DEMO_OUT) || exit 1; \
	if [ -t 0 ] && [ -t 1 ]; then \
		printf '\nTo cut by hand, open http://$(DEMO_ADDRESS) in a browser. Enter stops the server.\n'; read -r key; \
	fi

# Starts a server and lets a simulated Omni cut the liver through it, until Ctrl-C: no device is needed.
STATION_ADDRESS ?= 127.0.0.1:50052
STATION_ARGS ?=
station:
	$(RELEASE)
	@target/release/kerf-server serve --listen $(STATION_ADDRESS) --log-filter warn & server=$$!; \
	trap 'kill $$server 2>/dev/null; wait $$server' EXIT; trap 'exit 0' INT; \
	target/release/kerf-station run --server http://$(STATION_ADDRESS) --scene liver --config client/station/liver.toml \
		--wait-for-server 10 $(STATION_ARGS)

# Writes docs/explanation/haptics.md and its plots, in six minutes; nothing else should run: the whole loop on loopback and through
# networks that are made worse on purpose, and the stiffest tissue by round trip in virtual time.
haptics:
	mkdir -p out
	$(MAKE) --no-print-directory station STATION_ARGS="--json --duration 16" > out/haptics.log
	grep '^{' out/haptics.log > out/haptics.jsonl
	@target/release/kerf-server serve --listen $(STATION_ADDRESS) --log-filter warn & server=$$!; \
	trap 'kill $$server 2>/dev/null; wait $$server' EXIT; trap 'exit 1' INT; sleep 1; \
	target/release/kerf-station experiment docs/explanation --server $(STATION_ADDRESS) --loopback out/haptics.jsonl

# The web viewer's files, which the server's build takes in. Without Node the server says how to add them.
viewer: $(if $(NPM),client/web/dist/index.html)
	@$(if $(NPM),,echo "There is no npm here: the server comes without its web viewer.")

# What follows from the protocol is made by the build itself. In an image's stages some of the folders are missing.
VIEWER_SOURCES := $(wildcard client/web/*.*) \
	$(shell find client/web/src client/web/public proto/kerf -type f -not -path '*/gen/*' 2>/dev/null)
client/web/dist/index.html: $(VIEWER_SOURCES) | client/web/node_modules
	cd client/web && npm run --silent build

client/web/node_modules: client/web/package-lock.json
	cd client/web && npm install --no-save --no-audit --no-fund --loglevel=error && touch node_modules

# The documents as a book in docs/book, which the next build of the server takes in. It needs mdBook, which is installed
# below target/ where cargo may fetch it; formulas are drawn where npm has installed KaTeX.
MDBOOK_VERSION := 0.5.4
MDBOOK := $(or $(shell command -v mdbook),target/mdbook/bin/mdbook)
KATEX := client/web/node_modules/katex/dist
docs: $(MDBOOK) $(if $(NPM),client/web/node_modules)
	@$(MDBOOK) build docs
	@# A folder's README is its index in the book, but links to it keep its name.
	@find docs/book -name '*.html' -exec sed -i 's|href="\([^":]*\)README\.html|href="\1index.html|g' {} +
	@printf '# Made by `make docs`; the folder itself is here so that the server builds without it.\n*\n!.gitignore\n' > docs/book/.gitignore
	@rm -rf docs/book/book.toml docs/book/lint docs/book/print.html docs/book/reference/generate.py; \
	find docs/book/explanation docs/book/reference -name '*.svg' -delete
	@if [ -d $(KATEX) ]; then mkdir -p docs/book/katex/fonts && cp $(KATEX)/katex.min.js $(KATEX)/katex.min.css docs/book/katex && \
		cp $(KATEX)/fonts/*.woff2 docs/book/katex/fonts; \
	else echo "Formulas in the book stay as text: KaTeX is missing (npm install in client/web)."; fi
	@echo "The book is in docs/book; build the server to serve it at /docs."

target/mdbook/bin/mdbook:
	@cargo install --quiet --locked --root target/mdbook --version $(MDBOOK_VERSION) --no-default-features --features search mdbook || \
		{ echo "The book is not built: it needs mdBook $(MDBOOK_VERSION) (cargo install mdbook), which could not be installed."; exit 1; }

# Which modules import which, as Mermaid drawings on the terminal; that of the crates is written into CONTRIBUTING.md.
IMPORTS ?= $(wildcard server/*/src client/*/src proto/src tests/src)
imports:
	@python3 docs/lint/imports.py --crates CONTRIBUTING.md $(IMPORTS)

# Writes docs/reference/settings.md and scene-fields.md from what the program says.
reference:
	$(PROGRAMS)
	python3 docs/reference/generate.py target/debug/kerf-server

# The viewer first: programs that were built before it are built anew.
test: viewer
	cargo test --workspace
	@$(MAKE) --no-print-directory test-viewer
	@$(MAKE) --no-print-directory --jobs=2 --output-sync=target test-python test-unity

# The viewer's own tests, and those in a real browser. What is missing for them is said.
test-viewer: viewer
	$(PROGRAMS)
	@client/web/e2e/run.sh viewer

# The Python client against a live server. What is missing for it is said. Many tests wait: three at a time, of which one has Ray.
test-python:
	$(PROGRAMS)
	@client/python/check.sh tests pytest --quiet --numprocesses=3 --dist=loadgroup

# The Unity package and its sample, compiled by mono and tried against a server.
test-unity:
	$(PROGRAMS)
	@client/unity/Tests~/run.sh

# The package's C# of the protocol: Unity has no compiler for it. Needs protoc 3.21.
unity-protocol:
	protoc -I proto --csharp_out=client/unity/Runtime/Client/Generated $(addprefix kerf/v1/,$(addsuffix .proto,types session control view))

# Builds the images of docker/ and runs them, with an engine or without one.
images:
	@docker/try.sh

# The README's pictures of the viewer, drawn by the same browser, and the one that moves, put together by Pillow.
screenshots:
	$(PROGRAMS)
	@client/web/e2e/run.sh screenshots
	@client/python/check.sh "moving picture" python ../web/e2e/animate.py ../../out/cut ../../docs/images/cut.webp

# Writes docs/explanation/gallery.md and its pictures: the paper's figures, stepped in lock-step and drawn by the same browser, in
# some ten minutes; FIGURE=4 makes one of them.
FIGURE ?=
figures:
	$(PROGRAMS)
	@client/web/e2e/run.sh figures $(if $(FIGURE),"Fig. $(FIGURE):")

# The tests marked slow too, each with its reason, and same-bits. A sweep that prints what constants were read from takes
# minutes more: cargo test -p kerf-physics blade_stiffness_sweep -- --ignored --nocapture
test-all: same-bits
	cargo test --workspace -- --include-ignored --skip blade_stiffness_sweep

# Sessions that are killed, lose power and run out of disk, by seed, and are brought back by their journals: `make test`
# tries 40 seeds. A failure names its seed; LIVES_SEED=<seed> LIVES=1 repeats it.
LIVES ?= 1000
LIVES_SEED ?= 0
lives:
	LIVES=$(LIVES) LIVES_SEED=$(LIVES_SEED) cargo test --release -p kerf-server --lib --quiet journal::lives -- --nocapture

# A server, its clients, network, clock and disk in virtual time, by seed: `make test` tries 8 seeds. A failure names its
# seed; WORLDS_SEED=<seed> WORLDS=1 repeats it.
WORLDS ?= 1000
WORLDS_SEED ?= 0
worlds:
	WORLDS=$(WORLDS) WORLDS_SEED=$(WORLDS_SEED) cargo test --release -p kerf-server --lib --quiet virtual_world::clients -- --nocapture

# A server for SOAK_MINUTES under clients that make, cut, watch, stall, reset and leave sessions, with kills in the first
# quarter: whether a session is lost, and whether memory, descriptors or threads grow. Samples go to out/soak.csv.
SOAK_MINUTES ?= 120
SOAK_SEED ?= 1
soak:
	$(RELEASE)
	@client/python/check.sh soak python ../../tests/soak/soak.py --minutes $(SOAK_MINUTES) --seed $(SOAK_SEED) \
		--program ../../target/release/kerf-server --out ../../out/soak.csv

# Bytes that nobody meant, for as long with each of the readers, in Rust, TypeScript, Python and C#; `make test` does it for
# two seconds each. A failure names its seed and, in Rust, the file that has the input. FUZZ=state picks a reader of Rust's.
FUZZ_SECONDS ?= 60
FUZZ_SEED ?= 1
FUZZ ?=
fuzz: $(if $(NPM),client/web/node_modules)
	cargo test -p kerf-system-tests --no-run
	ulimit -v 8388608; FUZZ_SECONDS=$(FUZZ_SECONDS) FUZZ_SEED=$(FUZZ_SEED) RUST_BACKTRACE=0 \
		cargo test --quiet -p kerf-system-tests fuzz::$(FUZZ) -- --nocapture
	$(if $(NPM),cd client/web && FUZZ_SECONDS=$(FUZZ_SECONDS) FUZZ_SEED=$(FUZZ_SEED) npm test --silent -- test/fuzz.test.ts)
	@FUZZ_SECONDS=$(FUZZ_SECONDS) FUZZ_SEED=$(FUZZ_SEED) client/python/check.sh fuzzing pytest --quiet tests/test_fuzz.py
	@FUZZ_SECONDS=$(FUZZ_SECONDS) FUZZ_SEED=$(FUZZ_SEED) client/unity/Tests~/run.sh fuzz

# The readers of files, views and poses under libFuzzer, which keeps what reaches new code: each for FUZZ_SECONDS, or the one that FUZZ
# names. It needs a C++ compiler. An input that fails is written to target/fuzz/found; FUZZ_INPUT=<file> reads it once more.
FUZZ_TARGETS := $(basename $(notdir $(wildcard tests/fuzz/fuzz_targets/*.rs)))
FUZZ_INPUT ?=
GUIDED := --release --package kerf-fuzz --features libfuzzer
fuzz-guided:
	cargo --config tests/fuzz/guided.toml build $(GUIDED) $(if $(FUZZ),--bin $(FUZZ),--bins)
	mkdir -p target/fuzz/found
	grep -oE '`[a-z_0-9]+`' docs/reference/scene-fields.md | sort -u | tr '`' '"' > target/fuzz/scene.dict
	@ulimit -v 8388608; failed=; for target in $(or $(FUZZ),$(FUZZ_TARGETS)); do \
		mkdir -p target/fuzz/corpus/$$target target/fuzz/seeds/$$target; \
		FUZZ_SEEDS=target/fuzz/seeds/$$target cargo --config tests/fuzz/guided.toml run --quiet $(GUIDED) --bin $$target -- \
			-max_total_time=$(FUZZ_SECONDS) -seed=$(FUZZ_SEED) -timeout=20 -rss_limit_mb=2048 -print_final_stats=1 \
			-artifact_prefix=target/fuzz/found/$$target- $$(test $$target != scene || echo -dict=target/fuzz/scene.dict) \
			$(or $(FUZZ_INPUT),target/fuzz/corpus/$$target target/fuzz/seeds/$$target) || failed="$$failed $$target"; \
	done; test -z "$$failed" || { echo "Failed:$$failed"; exit 1; }

# The same strokes give the same bits in the tests' profile, in release and, where the machine has it, with AVX-512.
same-bits:
	@run() { RUSTFLAGS="-C target-cpu=$$1" cargo run --quiet --package kerf-physics --example state_hashes $$2; }; \
	wide=$$(grep -qw avx512f /proc/cpuinfo && echo x86-64-v4); \
	dev=$$(run x86-64-v3) && for cpu in x86-64-v3 $$wide; do \
		release=$$(run $$cpu --release) && test "$$dev" = "$$release" || { echo "$$cpu: $$release, not $$dev"; exit 1; }; \
	done; echo "same bits: $$dev"

# What the clients' tests need beside Rust, which each of them installs itself: here all of it is fetched at once, so that it
# can be while Rust compiles.
tools: $(if $(NPM),client/web/node_modules)
	@client/web/e2e/run.sh tools
	@client/unity/Tests~/run.sh tools
	@client/python/check.sh tools true

lint: lint-rust lint-clients

# Documents of the examples too: so dependencies have the features with which clippy has just checked them.
lint-rust:
	cargo fmt --all --check
	cargo clippy --workspace --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --lib --bins --examples

# Clients, protocol, manifests, workflows and prose.
lint-clients: $(if $(NPM),client/web/node_modules)
	$(if $(NPM),cd client/web && npm run --silent lint)
	$(if $(NPM),client/web/node_modules/.bin/buf lint proto)
	$(if $(NPM),client/web/node_modules/.bin/buf breaking proto --against proto/published.binpb)
	@client/python/check.sh lint sh -ec 'ruff check --quiet && ruff format --check --quiet && mypy'
	$(if $(NPM),cd client/web && node lint-workflows.mjs ../../.github/workflows/*.yml)
	@client/python/check.sh "lint of manifests" python ../../deploy/kubernetes/lint.py
	@client/python/check.sh "lint of images" hadolint ../../docker/Dockerfile
	@if command -v python3 >/dev/null; then \
		python3 docs/lint/imports.py --check --crates CONTRIBUTING.md $(IMPORTS) && git ls-files '*.md' | grep -v LICENSE | xargs python3 docs/lint/prose.py; \
	else echo "The linters of imports and of the documents' prose are left out: they need Python 3.11."; fi

# Takes the .proto files as they are for the version that later ones have to stay compatible with.
publish-protocol: client/web/node_modules
	client/web/node_modules/.bin/buf build proto --exclude-source-info --output proto/published.binpb

# Writes the tables and plots of docs/reference/verification, and from these docs/explanation/verification.md; figures are
# deterministic. verify-page, extremes-page and strokes-page write a page from its tables, without a run.
verify:
	cargo run --release -p kerf-system-tests --bin verify

verify-page:
	cargo run --release -p kerf-system-tests --bin verify -- --page-only

# Writes docs/explanation/experiment.md and its plot: a published needle in liver beside ours; figures are deterministic.
experiment:
	cargo run --release -p kerf-system-tests --bin experiment

# Writes docs/explanation/performance.md and its plots, in five minutes; nothing else should run.
performance:
	cargo run --release -p kerf-system-tests --bin performance

# Builds another commit below target/ and runs it and this one in turn on the same scenes: writes docs/explanation/compared.md,
# in half an hour; nothing else should run.
BASE ?= 9a4e652
ROUNDS ?= 5
compare:
	python3 tests/compare/run.py $(BASE) $(ROUNDS)

# Steps the same block in MuJoCo and Rapier and writes docs/explanation/peers.md; installs both below target/, which needs a network.
peers:
	$(RELEASE)
	cargo build --release --manifest-path tests/peers/rapier/Cargo.toml --target-dir target/peers
	test -d target/peers/python || python3 -m venv target/peers/python
	target/peers/python/bin/pip install --quiet mujoco==4.0.0
	target/peers/python/bin/python tests/peers/run.py

# One run each; figures belong to the machine they were taken on, which should have nothing else to do.
bench: performance
	cargo bench -p kerf-session --bench liver
	cargo bench -p kerf-server --bench stream
	cargo bench -p kerf-physics --bench step
	cargo bench -p kerf-system-tests --bench loopback
	cargo test --release -p kerf-session what_recording -- --ignored --nocapture

# Every supported range from end to end; writes docs/reference/stability and docs/explanation/stability.md, the same bytes
# from the same seed.
EXTREMES_SEED ?= 1
extremes:
	cargo run --release -p kerf-system-tests --bin extremes -- docs --seed $(EXTREMES_SEED)

extremes-page:
	cargo run --release -p kerf-system-tests --bin extremes -- docs --seed $(EXTREMES_SEED) --page-only

# Random strokes through built-in scenes and, where their paths are given, meshes; writes docs/reference/strokes and
# docs/explanation/strokes.md. A thousand through each of nine models take a quarter of an hour; it goes on where it was cut off:
# what was cut stands in STROKES_BODIES, to be removed when the physics changes.
STROKES ?= 1000
STROKES_SEED ?= 1
STROKES_PER_BODY ?= 8
STROKES_RESOLUTION ?= 20
STROKES_BODIES ?= out/strokes
STROKES_MODELS ?= liver gummy-bear jelly tofu rubber cuboid
strokes:
	cargo run --release -p kerf-system-tests --bin strokes -- docs $(STROKES_MODELS) \
		--strokes $(STROKES) --seed $(STROKES_SEED) --per-body $(STROKES_PER_BODY) \
		--resolution $(STROKES_RESOLUTION) --bodies $(STROKES_BODIES)

strokes-page:
	cargo run --release -p kerf-system-tests --bin strokes -- docs --bodies $(STROKES_BODIES) --page-only

# Random dicings of five built-in scenes; writes docs/explanation/dicing.md. Forty of each, on 24 voxels along the longest edge
# and of eight plunges, take half an hour of one core; at full size, by `DICE_ARGS=`, of twenty plunges they take ten hours. A
# run that was cut off goes on where it stood, by out/dicings.jsonl: remove that where the arguments change.
DICINGS ?= 40
DICE_SEED ?= 1
DICE_ARGS ?= --plunges 8 --resolution 24
dice:
	mkdir -p out
	cargo run --release -p kerf-system-tests --bin dice -- docs/explanation/dicing.md --made out/dicings.jsonl --dicings $(DICINGS) --seed $(DICE_SEED) $(DICE_ARGS)

# How many livers a server keeps at 60 Hz, and what 50 viewers cost: tables, and docs/explanation/load.md from these, in six
# minutes; nothing else should run. load-page writes the page without a run.
load:
	$(RELEASE)
	python3 tests/load/run.py

load-page:
	python3 tests/load/run.py --page-only

# Whether licences, sources and versions of what is depended on are as deny.toml has them, and, with the network's list,
# whether any of it is known to be unsafe.
deny: target/tools/bin/cargo-deny
	target/tools/bin/cargo-deny check licenses bans sources

advisories: target/tools/bin/cargo-deny
	target/tools/bin/cargo-deny check advisories

# A package for Debian in target/debian, with the viewer, the documents and what systemd is to run.
deb: viewer docs target/tools/bin/cargo-deb
	$(RELEASE)
	target/tools/bin/cargo-deb -p kerf-server --no-build --strip --output target/debian/

# What the programs consist of, as CycloneDX, in target/sbom.
sbom: target/tools/bin/cargo-cyclonedx
	target/tools/bin/cargo-cyclonedx cyclonedx --manifest-path server/app/Cargo.toml --format json --quiet
	mkdir -p target/sbom
	find . -name '*.cdx.json' -not -path './target/*' -exec mv {} target/sbom/ \;

# The images as files, for machines that no registry is reached from: docker load --input FILE
image-archives:
	mkdir -p target/images
	for target in server load; do \
		docker build --file docker/Dockerfile --target $$target --tag kerf-$$target . && \
		docker save kerf-$$target | gzip > target/images/kerf-$$target-image.tar.gz || exit 1; \
	done

# The Python client's package, for every processor: it has no code of the machine's.
wheel:
	@client/python/check.sh wheel pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir ../../target/wheel .

# What a release has of one kind of processor, by names that tell it, in target/release-files.
ARCHITECTURE ?= $(shell uname -m)
release-files:
	mkdir -p target/release-files
	cp target/debian/*.deb target/release-files/
	for file in target/sbom/*.cdx.json target/images/*.tar.gz; do \
		name=$$(basename $$file); cp $$file target/release-files/$${name%%.*}-$(ARCHITECTURE).$${name#*.} || exit 1; \
	done

checksums:
	cd target/release-files && rm -f SHA256SUMS && sha256sum -- * > ../SHA256SUMS && mv ../SHA256SUMS .

# What CHANGELOG.md says of a version, if all files state that one.
VERSION ?= $(shell sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml)
release-notes:
	@python3 deploy/release/notes.py $(VERSION)

TOOL_VERSION_cargo-deny := 0.20.2
TOOL_VERSION_cargo-deb := 3.8.0
TOOL_VERSION_cargo-cyclonedx := 0.5.9
target/tools/bin/%:
	cargo install --quiet --locked --root target/tools --version $(TOOL_VERSION_$*) $*
