# GNU make. `make help` lists the targets; every one of them may be run again at any time.

TASK ?= cartpole-swingup
ARGS ?=
DEVICE ?= cpu
FEATURES ?= $(if $(filter cuda%,$(DEVICE)),cuda)
SECONDS ?= 600
PREFIX ?= $(HOME)/.local
PYTHON ?= python3

target = $(or $(CARGO_TARGET_DIR),target)/release
distractors = none color-easy color-medium camera-easy camera-medium
place = $(DESTDIR)$(PREFIX)

.PHONY: help setup build train test check wheel python-test fuzz thirty bench book install uninstall clean
.DEFAULT_GOAL := help

help: ## this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "make %-11s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)
	@echo "variables: TASK=$(TASK) ARGS='$(ARGS)' DEVICE=$(DEVICE) FEATURES='$(FEATURES)' PREFIX=$(PREFIX) SECONDS=$(SECONDS) PYTHON=$(PYTHON)"

setup: ## fetch MuJoCo and the model files (pinned), look for graphics
	@scripts/fetch-native.sh

build: setup ## the binary, in release mode; FEATURES=cuda for NVIDIA's GPUs
	cargo build --release -p hksl-cli $(if $(FEATURES),--features $(FEATURES))

train: build ## train HKSL on TASK; ARGS go to `hksl train`
	$(target)/hksl train $(TASK) $(ARGS)

# In release mode: the tests train networks, and share what `make build` has compiled.
test: build ## every test, in release mode
	cargo test --workspace --release

# In release mode, too: build scripts and macros are compiled already.
check: setup ## formatting and lints, warnings denied
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --release -- -D warnings

wheel: setup ## the Python package, into target/wheels
	$(PYTHON) -m pip wheel --no-deps --wheel-dir target/wheels .

python-test: setup ## the Python package's tests, in a virtual environment under target/python; ARGS go to pytest
	PYTHON=$(PYTHON) scripts/python-test.sh $(ARGS)

# Needs a nightly compiler and `cargo install cargo-fuzz`.
fuzz: setup ## fuzz the readers, SECONDS each; what is found lands in fuzz/artifacts
	@cd fuzz && for target in configuration checkpoint rollout episode; do \
	  mkdir -p target/found/$$target; \
	  LD_LIBRARY_PATH=$(CURDIR)/.native/mujoco cargo +nightly fuzz run $$target \
	    target/found/$$target corpus/$$target -- -max_total_time=$(SECONDS) -rss_limit_mb=4096 || exit; \
	done

thirty: build ## a debug run of each of the paper's thirty control tasks, under target/thirty
	@for task in $$($(target)/hksl tasks --quiet | awk '$$6 == "yes" { print $$1 }'); do for distractor in $(distractors); do \
	  echo "$$task, $$distractor"; \
	  $(target)/hksl train $$task --distractor $$distractor --preset debug --runs target/thirty $(ARGS) || exit; \
	done; done

bench: build ## learning steps beside PyTorch's on DEVICE, into results/learning-step; ARGS go to bench/compare.py
	$(PYTHON) bench/compare.py --hksl $(target)/hksl --device $(DEVICE) $(ARGS)

book: setup ## docs/ as pages to read in a browser, under target/book
	cargo build --workspace --release --example book
	$(target)/examples/book

# The binary finds both beside itself, so it works from any folder and without this checkout.
install: build ## hksl, its library, models, man pages and completions under PREFIX
	install -d "$(place)/bin" "$(place)/lib/hksl" "$(place)/share/hksl/models/suite/common"
	install -m 755 $(target)/hksl "$(place)/bin/hksl"
	install -m 644 .native/mujoco/libmujoco.so.3.17.0 "$(place)/lib/hksl/"
	ln -sf libmujoco.so.3.17.0 "$(place)/lib/hksl/libmujoco.so"
	install -m 644 .native/models/suite/*.xml "$(place)/share/hksl/models/suite/"
	install -m 644 .native/models/suite/common/*.xml "$(place)/share/hksl/models/suite/common/"
	install -d "$(place)/share/bash-completion/completions" "$(place)/share/zsh/site-functions" \
	  "$(place)/share/fish/vendor_completions.d"
	$(target)/hksl completions bash > "$(place)/share/bash-completion/completions/hksl"
	$(target)/hksl completions zsh > "$(place)/share/zsh/site-functions/_hksl"
	$(target)/hksl completions fish > "$(place)/share/fish/vendor_completions.d/hksl.fish"
	$(target)/hksl man "$(place)/share/man/man1" --quiet
	@case ":$$PATH:" in *":$(PREFIX)/bin:"*) ;; *) echo "add $(PREFIX)/bin to your PATH" ;; esac

uninstall: ## what `make install` put there
	rm -f "$(place)/bin/hksl"
	rm -rf "$(place)/lib/hksl" "$(place)/share/hksl"
	rm -f "$(place)/share/bash-completion/completions/hksl" "$(place)/share/zsh/site-functions/_hksl" \
	  "$(place)/share/fish/vendor_completions.d/hksl.fish" "$(place)"/share/man/man1/hksl*.1

clean: ## build output; what setup fetched stays in .native/
	cargo clean
