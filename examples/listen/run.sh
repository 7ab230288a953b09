#!/bin/sh
# A scan end to end through ALSA: a simulated rig plays its hits into a sound card that is a pipe, and a line hears them.
# Usage: run.sh TAPLINE FOLDER
set -eu
tapline=$(realpath "$1")
here=$(realpath "$(dirname "$0")")
mkdir -p "$2" && cd "$2"
rm -rf casings shoulder.pcm && mkfifo shoulder.pcm
cat >asound.conf <<END
pcm.null { type null }
pcm.shoulder { type file slave.pcm null file /dev/null infile "$PWD/shoulder.pcm" format raw }
END
export ALSA_CONFIG_PATH="$PWD/asound.conf"
"$tapline" calibrate state --channel force --full-scale-v 5 --sensitivity-mv 22.5 --out calibration.toml --force
"$tapline" calibrate state --channel sound --full-scale-v 5 --out calibration.toml --force
"$tapline" rig --listen 127.0.0.1:7001 --config "$here/rig.toml" &
rig=$!
trap 'kill $rig 2>/dev/null || true' EXIT
# One that cannot listen, because the port is taken, says so and ends.
sleep 1 && kill -0 $rig
"$tapline" line --config "$here/plant.toml" --reference self --out casings --casings 2
echo "Each casing has its archive in $PWD/casings."
