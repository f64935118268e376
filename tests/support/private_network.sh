# Sourced first by scripts whose programs talk over the network, with the script's arguments: runs the script again in a
# private network with multicast, which needs root, or ends it as skipped (77).
if [ "${PM_PRIVATE_NETWORK:-}" != yes ]; then
    if ! { [ "$(id -u)" -eq 0 ] && unshare -n true; } 2>/dev/null; then
        echo "skipped: a private network needs root"
        exit 77
    fi
    PM_PRIVATE_NETWORK=yes exec unshare -n sh "$0" "$@"
fi
ip link set lo up
ip link set lo multicast on
ip route add 224.0.0.0/4 dev lo
