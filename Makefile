# Two commands: `make demo` and `make test`. Both install what is missing first (Debian, Ubuntu).

PACKAGES = libasound2-dev libhdf5-dev pkg-config python3-h5py hdf5-filter-plugin-blosc-serial
DEMO = demo
LISTEN = target/listen

.PHONY: setup python demo listen test gates bench atlas

# Rust, gcc and make are taken for granted; all else is asked for here, and only what is missing is installed.
define install
	@missing=""; for package in $(1); do \
	  dpkg-query -W -f='$${Status}' $$package 2>/dev/null | grep -q 'install ok installed' || missing="$$missing $$package"; \
	done; \
	if [ -n "$$missing" ]; then \
	  echo "installing$$missing"; \
	  if [ "$$(id -u)" = 0 ]; then sudo=""; else sudo="sudo"; fi; \
	  $$sudo apt-get update -qq && DEBIAN_FRONTEND=noninteractive $$sudo apt-get install -y -qq --no-install-recommends $$missing; \
	fi
endef

setup:
	$(call install,$(PACKAGES))

# What tests read files and pages back with, Python's part in a folder of its own. With TAPLINE_REQUIRE_ALL=1 no test is skipped.
PYTHON = target/python/bin/python
python: setup
	$(call install,chromium mosquitto mosquitto-clients)
	@test -x $(PYTHON) || python3 -m venv target/python
	@$(PYTHON) -m pip install -q --disable-pip-version-check -r tests/python.txt

# Two stations: a cracked tyre and a sound one, a file each.
demo: setup
	cargo build --release -p tapline --no-default-features
	@rm -rf $(DEMO)/casings && mkdir -p $(DEMO)
	target/release/tapline run --stations 2 --config examples/demo.toml --out $(DEMO)/casings
	@for table in verdicts regions damage discriminators; do \
	  target/release/tapline export $(DEMO)/casings $$table --out $(DEMO)/$$table.csv || exit 1; \
	done
	target/release/tapline report $(DEMO)/casings --out $(DEMO)/report
	@echo "Each casing's archive is in $(DEMO)/casings; the result is $(DEMO)/verdicts.csv, with regions.csv, damage.csv and discriminators.csv beside it; read $(DEMO)/report/shift.html."

# A scan through a sound card, which is a pipe here: two casings, in about three minutes once built.
listen: setup
	cargo build --release -p tapline
	examples/listen/run.sh target/release/tapline $(LISTEN)

test: setup
	cargo test --workspace

gates: setup
	cargo fmt --all --check
	cargo clippy --workspace --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --document-private-items

bench: setup
	cargo bench --bench '*'

# Speed against accuracy of everything that can be chosen, measured on this machine: docs/atlas.
atlas: setup
	cargo run --release -p tapline-lab -- chart
