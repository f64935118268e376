#!/bin/sh
# SPDX-License-Identifier: MIT
# loopback.sh COMMAND...: inside a fresh network namespace, gives the loopback device multicast, then
# runs the command there.
set -eu
ip link set lo up
ip link set lo multicast on
ip route add 224.0.0.0/4 dev lo
exec "$@"
