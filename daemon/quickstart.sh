#!/bin/sh
# From a clean clone to two learned pendula, each in its own process, exchanging energy and entropy
# over LCM: installs what is missing, builds, runs. May be run again at any time.
set -eu
cd "$(dirname "$0")/.."
. daemon/setup.sh

need_packages $build_packages
build_into build

run="build/daemon/app/portmetd run configs/double_pendulum.yaml"
prefix=$(private_network)
if [ -n "$prefix" ]; then
    echo "running in a private network"
else
    echo "running on this host's loopback (multicast with ttl 0)"
fi
echo
$prefix $run
echo
echo "again: $run"
[ -z "$prefix" ] || echo "   or: $prefix $run"
