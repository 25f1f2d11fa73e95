#!/bin/sh
# Runs a command at one end of a cable between two machines, which are network namespaces.
#
#   cable.sh on|off COMMAND...    with or without multicast
#
# The command has the address 10.77.0.1 at `here`. TELLTALE_TEST_OTHER_MACHINE is a process of the other machine, which
# has 10.77.0.2 at `there`. Root may lay cables; other users in a user namespace of their own.
set -e
if [ "$1" != laid ]; then
    if unshare --net true 2>/dev/null; then own=--net; else own='--user --map-root-user --net'; fi
    exec unshare $own sh "$0" laid "$@"
fi
multicast=$2
shift 2
ip link set lo up
unshare --net sleep 300 & other=$!
trap 'kill $other' EXIT
until [ "$(readlink /proc/$other/ns/net)" != "$(readlink /proc/self/ns/net)" ]; do sleep 0.05; done
ip link add here type veth peer name there
ip link set there netns $other
ip addr add 10.77.0.1/24 dev here
ip link set here multicast "$multicast" up
nsenter --target $other --net sh -c "
    ip link set lo up
    ip addr add 10.77.0.2/24 dev there
    ip link set there multicast $multicast up"
TELLTALE_TEST_OTHER_MACHINE=$other "$@"
