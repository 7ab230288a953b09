# Two commands: `make demo` and `make test`. Both install what is missing first (Debian, Ubuntu).

PACKAGES = libasound2-dev libhdf5-dev pkg-config python3-h5py hdf5-filter-plugin-blosc-serial
DEMO = demo
LISTEN = target/listen

# Where `make install` puts things, and where the built programs are.
PREFIX = /usr/local
DESTDIR =
BINARIES = target/release
PACKAGED = target/package

.PHONY: setup python demo listen test gates bench install packaged package atlas

# Rust, gcc and make must be there; everything else is checked here, and only what is missing is installed.
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

# What tests read files and pages with; Python in its own folder. With TAPLINE_REQUIRE_ALL=1 no test is skipped.
PYTHON = target/python/bin/python
python: setup
	$(call install,chromium iproute2 mosquitto mosquitto-clients)
	@test -x $(PYTHON) || python3 -m venv target/python
	@$(PYTHON) -m pip install -q --disable-pip-version-check -r tests/python.txt

# Two stations: a cracked tyre and a sound one, a file each.
demo: setup
	cargo build --profile demo -p tapline --no-default-features
	@rm -rf $(DEMO)/casings && mkdir -p $(DEMO)
	target/demo/tapline run --stations 2 --config examples/demo.toml --out $(DEMO)/casings
	@for table in verdicts regions damage discriminators; do \
	  target/demo/tapline export $(DEMO)/casings $$table --force --out $(DEMO)/$$table.csv || exit 1; \
	done
	target/demo/tapline report $(DEMO)/casings --force --out $(DEMO)/report
	@echo "Each casing's archive is in $(DEMO)/casings; the result is $(DEMO)/verdicts.csv, with regions.csv, damage.csv and discriminators.csv beside it; read $(DEMO)/report/shift.html."

# A scan through a sound card, here a pipe: two casings, in about a minute once built.
listen: setup
	cargo build --release -p tapline
	examples/listen/run.sh target/release/tapline $(LISTEN)

test: python
	TAPLINE_PYTHON="$${TAPLINE_PYTHON:-$(CURDIR)/$(PYTHON)}" cargo test --workspace

gates: setup
	$(call install,libusb-1.0-0-dev libclang-dev g++)
	cargo fmt --all --check
	cargo clippy --workspace --all-targets -- -D warnings
	cargo clippy -p tapline --no-default-features -- -D warnings
	cargo clippy -p tapline-acquire --features uldaq -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --document-private-items

# Everything that docs/performance.md has, measured on this machine.
BENCH_PYTHON = target/python-bench/bin/python
bench: setup
	@test -x $(BENCH_PYTHON) || python3 -m venv target/python-bench
	@$(BENCH_PYTHON) -m pip install -q --disable-pip-version-check -r benches/python.txt
	cargo build --release -p tapline
	TAPLINE_BENCH_PYTHON=$(CURDIR)/$(BENCH_PYTHON) cargo bench -p tapline-bench --features zeromq
	cargo run --release -p tapline-bench

# What the built program generates: manual pages, completions, a complete configuration.
packaged:
	@rm -rf $(PACKAGED) && mkdir -p $(PACKAGED)/completions
	@$(BINARIES)/tapline man $(PACKAGED)/man
	@$(BINARIES)/tapline completions bash > $(PACKAGED)/completions/tapline.bash
	@$(BINARIES)/tapline completions zsh > $(PACKAGED)/completions/_tapline
	@$(BINARIES)/tapline completions fish > $(PACKAGED)/completions/tapline.fish
	@$(BINARIES)/tapline config --example > $(PACKAGED)/line.toml

# After `cargo build --release -p tapline`, for example as `sudo make install`. An existing configuration stays.
install: packaged
	install -D -m 755 $(BINARIES)/tapline $(DESTDIR)$(PREFIX)/bin/tapline
	install -d $(DESTDIR)$(PREFIX)/share/man/man1
	install -m 644 $(PACKAGED)/man/*.1 $(DESTDIR)$(PREFIX)/share/man/man1/
	install -D -m 644 $(PACKAGED)/completions/tapline.bash $(DESTDIR)$(PREFIX)/share/bash-completion/completions/tapline
	install -D -m 644 $(PACKAGED)/completions/_tapline $(DESTDIR)$(PREFIX)/share/zsh/site-functions/_tapline
	install -D -m 644 $(PACKAGED)/completions/tapline.fish $(DESTDIR)$(PREFIX)/share/fish/vendor_completions.d/tapline.fish
	install -D -m 644 $(PACKAGED)/line.toml $(DESTDIR)$(PREFIX)/share/doc/tapline/examples/line.toml
	install -D -m 644 packaging/tapline.service $(DESTDIR)$(PREFIX)/lib/systemd/system/tapline.service
	sed -i 's|/usr/bin/tapline|$(PREFIX)/bin/tapline|' $(DESTDIR)$(PREFIX)/lib/systemd/system/tapline.service

# A Debian package, in target/debian, of the built program; needs cargo-deb.
package: packaged
	cargo deb -p tapline --no-build --no-strip

# Speed against accuracy of everything that can be chosen, measured on this machine: docs/atlas.
atlas: setup
	cargo run --release -p tapline-lab -- chart --force
