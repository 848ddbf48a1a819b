#!/bin/sh
# Says where a Prometheus with its promtool is: on the path, or else Debian's package, unpacked below target/ without
# root. Ends with status 1 and a word where none can be had.
set -eu
if command -v prometheus >/dev/null && command -v promtool >/dev/null; then
    dirname "$(command -v prometheus)"
    exit
fi
cd "$(dirname "$0")/../.."
unpacked=target/prometheus
if [ ! -x $unpacked/usr/bin/promtool ]; then
    for tool in apt-get dpkg-deb; do
        command -v $tool >/dev/null || { echo "there is neither Prometheus nor $tool here" >&2; exit 1; }
    done
    # Aside first: tests that look meanwhile find all of it or nothing, and the first that has it is the one that counts.
    part=$unpacked/part.$$
    mkdir -p $part
    trap 'rm -rf $part' EXIT
    (cd $part && apt-get -qq -o Acquire::Retries=0 -o Acquire::http::Timeout=10 download prometheus) >/dev/null 2>&1 ||
        { echo "there is no Prometheus here, and Debian's package cannot be fetched" >&2; exit 1; }
    dpkg-deb -x $part/prometheus_*.deb $part
    mv -T $part/usr $unpacked/usr 2>/dev/null || [ -x $unpacked/usr/bin/promtool ]
fi
echo "$PWD/$unpacked/usr/bin"
