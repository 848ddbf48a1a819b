#!/bin/sh
# Runs the viewer's tests: those of its modules, then the browser's that are named (viewer, screenshots, cost or
# figures), all of them or those with a name like the second argument. `run.sh tools` only installs the browser.
# A browser is installed where Debian's packages may be; what cannot be had is said, and left out.
set -eu
cd "$(dirname "$0")/.."

if ! command -v npm >/dev/null; then
    echo "The viewer's tests are left out: they need Node 20 or later (npm)."
    exit 0
fi
CHROMIUM=${CHROMIUM:-$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)}
if [ -z "$CHROMIUM" ] && command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
    apt-get update -qq && apt-get install -qqy chromium && CHROMIUM=$(command -v chromium)
fi
[ "$1" != tools ] || exit 0
make --no-print-directory -C ../.. viewer
npm test --silent

if [ -z "$CHROMIUM" ]; then
    echo "The viewer's tests in a browser are left out: they need Chromium (Debian: apt-get install chromium)."
    exit 0
fi
export CHROMIUM
npx --no-install vitest run --config e2e/vitest.config.ts "$1" ${2:+--testNamePattern "$2"}
