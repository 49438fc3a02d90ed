#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Builds the image for an OpenCR where arduino-cli and ROBOTIS's core are present: sh firmware/opencr/build.sh [OUT]
set -eu

here=$(cd "$(dirname "$0")" && pwd)
out=${1:-build/opencr}
board=OpenCR:OpenCR:OpenCR

command -v arduino-cli >/dev/null || {
    echo "there is no arduino-cli; docs/how-to/flash-the-imu-node.md says where it comes from" >&2
    exit 2
}
arduino-cli core list | grep -q '^OpenCR:OpenCR' || {
    echo "arduino-cli has no core OpenCR:OpenCR; docs/how-to/flash-the-imu-node.md says how to install it" >&2
    exit 2
}

# The tool takes one folder with all sources in it.
sketch=$out/imu_node
rm -rf "$sketch"
mkdir -p "$sketch"
cp "$here"/imu_node/imu_node.ino "$here"/../node/*.h "$here"/../node/*.cpp "$sketch"
arduino-cli compile --fqbn "$board" --output-dir "$out" "$sketch"
echo "$out/imu_node.ino.bin"
