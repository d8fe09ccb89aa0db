#!/usr/bin/env bash
# Prints the name of this machine in bench/results: MACHINE, or the processor and its number of cores.
set -euo pipefail
cores=$(getconf _NPROCESSORS_ONLN)
model=$(awk -F ': ' '/^model name/ { print $2; exit }' /proc/cpuinfo 2> /dev/null || true)
model=${model:-$(sysctl -n machdep.cpu.brand_string 2> /dev/null || uname -m)}
case ${1:-} in
    --describe)
        memory=$(awk '/^MemTotal/ { printf ", %.0f GB of memory", $2 / 1e6 }' /proc/meminfo 2> /dev/null || true)
        echo "$model, $cores cores$memory, $(uname -sm), $(rustc --version 2> /dev/null | cut -d ' ' -f 1-2 || true)."
        ;;
    *) echo "${MACHINE:-$model $cores cores}" | tr '[:upper:]' '[:lower:]' | sed 's/([^)]*)//g; s/[^a-z0-9.]\{1,\}/-/g' ;;
esac
