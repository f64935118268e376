#!/bin/sh
# SPDX-License-Identifier: MIT
# spy.sh [--url URL]: starts lcm-spy, LCM's window on all channels, with portmet's types decoded.
# Debian's own lcm-spy script asks Java for an option that no longer exists and misses its chart
# library, so Java is called directly. Needs a display.
set -eu
cd "$(dirname "$0")/.."
. daemon/setup.sh

usage="usage: sh daemon/spy.sh [--url URL]"
while [ $# -gt 0 ]; do
    case $1 in
    --url)
        [ $# -ge 2 ] || { echo "spy.sh: --url: a URL must follow" >&2; exit 2; }
        export LCM_DEFAULT_URL="$2"
        shift 2
        ;;
    --help) echo "$usage"; exit 0 ;;
    *) echo "spy.sh: does not know $1; $usage" >&2; exit 2 ;;
    esac
done

# The decoders are generated into a folder that anybody may write, also where this script is installed.
types=${XDG_CACHE_HOME:-$HOME/.cache}/portmet/spy
mkdir -p "$types"
logs=$types
[ -n "${DISPLAY:-}" ] || { echo "spy.sh: lcm-spy needs a display, and DISPLAY names none" >&2; exit 2; }
need_packages liblcm-bin liblcm-java default-jre libjchart2d-java ecj python3

java=/usr/share/java
lcm-gen -j --jpath "$types" lcmtypes/portmet.lcm
# Debian's small compiler for Java needs no JDK.
ecj -proc:none -nowarn -source 8 -target 8 -cp $java/lcm.jar -d "$types/classes" "$types"/portmet/*.java
rm -f "$types/types.jar"
(cd "$types/classes" && python3 -m zipfile -c ../types.jar portmet)

exec java -Djava.net.preferIPv4Stack=true -Xmx128m \
    -cp "$java/lcm.jar:$java/jchart2d.jar:$types/types.jar" lcm.spy.Spy
