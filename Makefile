# Two commands: `make demo` and `make test`. Both install what is missing first (Debian, Ubuntu).

PACKAGES = libhdf5-dev pkg-config python3-h5py hdf5-filter-plugin-blosc-serial
DEMO = demo

.PHONY: setup demo test gates bench

# Rust, gcc and make are taken for granted; all else is asked for here, and only what is missing is installed.
setup:
	@missing=""; for package in $(PACKAGES); do \
	  dpkg-query -W -f='$${Status}' $$package 2>/dev/null | grep -q 'install ok installed' || missing="$$missing $$package"; \
	done; \
	if [ -n "$$missing" ]; then \
	  echo "installing$$missing"; \
	  if [ "$$(id -u)" = 0 ]; then sudo=""; else sudo="sudo"; fi; \
	  $$sudo apt-get update -qq && DEBIAN_FRONTEND=noninteractive $$sudo apt-get install -y -qq --no-install-recommends $$missing; \
	fi

# A simulated line of two stations: a cracked tyre and a sound one.
demo: setup
	cargo build --release
	@mkdir -p $(DEMO) && rm -f $(DEMO)/demo.h5
	cargo run -q --release -- run --stations 2 --config examples/demo.toml --out $(DEMO)/demo.h5
	@for table in verdicts regions damage discriminators; do \
	  cargo run -q --release -- export $(DEMO)/demo.h5 $$table --out $(DEMO)/$$table.csv || exit 1; \
	done
	cargo run -q --release -- report $(DEMO)/demo.h5 --out $(DEMO)/report
	@echo "The archive is $(DEMO)/demo.h5; the result is $(DEMO)/verdicts.csv, with regions.csv, damage.csv and discriminators.csv beside it; read $(DEMO)/report/shift.html."

test: setup
	cargo test --workspace

gates: setup
	cargo fmt --all --check
	cargo clippy --workspace --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --document-private-items

bench: setup
	cargo bench --bench '*'
