#!/bin/sh
# Builds both images, starts the server from one and loads it from the other. With an engine that is docker compose, and
# the server is killed: its session has to come back.
# Without one, buildah does it as root in a chroot, on a Debian from debootstrap; it borrows this machine's Rust, Node and
# mdBook, since there the usual images cannot be fetched. What is missing is said, and nothing is tried.
set -eu
cd "$(dirname "$0")/.."

has() { command -v "$1" >/dev/null; }

# wait_until WHAT COMMAND...: ten seconds for the command to succeed; WHAT is said where it does not.
wait_until() {
    what=$1; tries=0
    shift
    until "$@"; do
        tries=$((tries + 1)); [ $tries -lt 20 ] || { echo "images: $what"; exit 1; }
        sleep 0.5
    done
}

if has docker && docker info >/dev/null 2>&1; then
    # A project of its own: nobody's sessions and tokens are touched.
    compose="docker compose --project-name kerf-try --file docker/compose.yaml --profile load"
    trap '$compose down --volumes' EXIT
    $compose build
    $compose run --rm load
    access="--server https://server:50051 --ca-file clients/certificate.pem --token-file clients/load"
    $compose run --rm load $access --scene liver --step-rates 60 --strokes 1 --depth 0.05 --speed 0.05 --keep-session
    $compose exec -T server sh -c 'kill -9 $(pidof kerf-server)'
    is_back() { $compose run --rm --entrypoint kerf-server access session $access list | grep running; }
    wait_until "the session is not back" is_back
    exit
fi
for tool in buildah debootstrap cargo npm; do
    has $tool || { echo "images: skipped, there is neither a docker engine nor $tool here"; exit 0; }
done
[ "$(id -u)" = 0 ] || { echo "images: skipped, buildah without an engine needs root"; exit 0; }

export BUILDAH_ISOLATION=chroot STORAGE_DRIVER=vfs
scratch=$(mktemp -d); containers=
trap 'for name in $containers; do buildah rm "$name" >/dev/null; done; rm -rf "$scratch"' EXIT

container() { containers="$containers $2"; buildah from --name "$2" "$1" >/dev/null; }

if ! buildah inspect kerf-debian >/dev/null 2>&1; then
    debootstrap --variant=minbase bookworm "$scratch/debian" >/dev/null
    container scratch kerf-debian-of-scratch
    buildah copy -q kerf-debian-of-scratch "$scratch/debian" / >/dev/null
    buildah commit -q kerf-debian-of-scratch kerf-debian >/dev/null
    container kerf-debian kerf-build-of-debian
    buildah run kerf-build-of-debian -- sh -c 'apt-get -q update && apt-get -qy install --no-install-recommends \
        gcc libc6-dev libstdc++6 make ca-certificates' >/dev/null
    buildah config --env PATH=/opt/rust/bin:/opt/node/bin:/usr/sbin:/usr/bin:/sbin:/bin \
        --env NODE_EXTRA_CA_CERTS=/etc/ssl/certs/ca-certificates.crt kerf-build-of-debian
    buildah commit -q kerf-build-of-debian kerf-build >/dev/null
fi

# npm finds its own files beside the link that it is called by.
mkdir -p "$scratch/node/bin" "$scratch/node/lib"
cp -L "$(command -v node)" "$scratch/node/bin/node"
cp -a "$(dirname "$(readlink -f "$(command -v npm)")")/.." "$scratch/node/lib/npm"
ln -s ../lib/npm/bin/npm-cli.js "$scratch/node/bin/npm"
make --silent target/mdbook/bin/mdbook
registry=${CARGO_HOME:-$HOME/.cargo}/registry
for target in server load; do
    buildah bud -q --layers --format docker -f docker/Dockerfile --target $target -t kerf-$target \
        --build-arg NODE_IMAGE=localhost/kerf-build --build-arg RUST_IMAGE=localhost/kerf-build \
        --build-arg RUNTIME_IMAGE=localhost/kerf-debian \
        --volume "$(rustc --print sysroot):/opt/rust:ro" --volume "$scratch/node:/opt/node:ro" \
        --volume "$PWD/target/mdbook:/kerf/target/mdbook:ro" \
        --volume "$registry:/root/.cargo/registry" --volume /etc/ssl/certs:/etc/ssl/certs:ro . >/dev/null
done

container kerf-server kerf-try-server
container kerf-load kerf-try-load
of_server() { buildah run kerf-try-server -- "$@"; }

of_server kerf-server serve --listen 127.0.0.1:50061 --security-dir security & server=$!
answers() {
    of_server kerf-server session --server 127.0.0.1:50061 --ca-file security/certificate.pem health >/dev/null 2>&1
}
wait_until "the server does not answer" answers
of_server kerf-server token new --name load --role driver --file security/tokens.toml >"$scratch/token"
of_server cat security/certificate.pem >"$scratch/certificate.pem"
buildah copy -q --chown 10001 kerf-try-load "$scratch/token" "$scratch/certificate.pem" /var/lib/kerf/ >/dev/null
# The server reads its tokens again within a second.
sleep 2
buildah run kerf-try-load -- kerf-load --server https://127.0.0.1:50061 --ca-file certificate.pem --token-file token \
    --scene liver --step-rates 500,250,60 --strokes 1 --jitter 0 --depth 0.05 --speed 0.05
of_server id -un
kill $server; wait $server 2>/dev/null || true
buildah images --filter reference=kerf-server --filter reference=kerf-load --format '{{.Name}} {{.Size}}'
