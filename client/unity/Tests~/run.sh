#!/bin/sh
# Compiles the package's pure part with mono and tries it against a server. Mono is installed where Debian's packages may
# be; what cannot be had is said.
set -eu
cd "$(dirname "$0")/../../.."
server=target/debug/kerf-server
build=target/unity

if ! command -v mcs >/dev/null && command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
    apt-get update -qq && apt-get install -qqy --no-install-recommends mono-mcs mono-runtime protobuf-compiler >/dev/null 2>&1 || true
fi
for tool in mcs mono protoc python3; do
    command -v $tool >/dev/null || { echo "unity: skipped, there is no $tool here (Debian: mono-mcs mono-runtime protobuf-compiler)"; exit 0; }
done
mkdir -p $build
if [ ! -e $build/Google.Protobuf.dll ]; then
    # Sources come from where packages do.
    debian=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' | head -n 1)
    echo "deb-src $debian $(. /etc/os-release; echo "$VERSION_CODENAME") main" > $build/sources.list
    apt="-o Dir::Etc::SourceList=$PWD/$build/sources.list -o Dir::Etc::SourceParts=- -o Dir::State::Lists=$PWD/$build/lists -qq"
    mkdir -p $build/lists/partial
    (cd $build && apt-get $apt update && apt-get $apt source --download-only protobuf) >$build/apt.log 2>&1 ||
        { echo "unity: skipped, Debian's source of protobuf cannot be fetched ($build/apt.log)"; exit 0; }
    tar xzf $build/protobuf_*.orig.tar.gz -C $build --wildcards '*/csharp/src/Google.Protobuf/*.cs'
    runtime=$(echo $build/protobuf-*/csharp/src/Google.Protobuf)
    python3 client/unity/Tests~/protobuf.py "$runtime"
    mcs -langversion:7.2 -target:library -unsafe -d:GOOGLE_PROTOBUF_REFSTRUCT_COMPATIBILITY_MODE -nowarn:1570,1591,618 \
        -out:$build/Google.Protobuf.dll -recurse:"$runtime/*.cs"
fi

# What is checked in is what the protocol's files say.
mkdir -p $build/generated
protoc -I proto --csharp_out=$build/generated kerf/v1/types.proto kerf/v1/session.proto kerf/v1/control.proto kerf/v1/view.proto
diff -r $build/generated client/unity/Runtime/Client/Generated >$build/generated.diff ||
    { echo "unity: client/unity/Runtime/Client/Generated is not what proto/ says: make unity-protocol"; exit 1; }

mcs -langversion:7.2 -target:library -d:GOOGLE_PROTOBUF_REFSTRUCT_COMPATIBILITY_MODE -warnaserror -nowarn:1591 \
    -r:$build/Google.Protobuf.dll -out:$build/Kerf.Client.dll -recurse:'client/unity/Runtime/Client/*.cs'
mcs -langversion:7.2 -warnaserror -r:$build/Google.Protobuf.dll,$build/Kerf.Client.dll -out:$build/LiveTest.exe \
    client/unity/Tests~/LiveTest.cs

port=50071
$server serve --listen 127.0.0.1:$port --log-filter error & started=$!
trap 'kill $started 2>/dev/null; wait $started 2>/dev/null || true' EXIT
tries=0
until $server session --server 127.0.0.1:$port list >/dev/null 2>&1; do
    tries=$((tries + 1)); [ $tries -lt 50 ] || { echo "unity: the server does not answer"; exit 1; }
    sleep 0.2
done
# What the recorded streams show, in lines that need no reader of JSON.
for stream in cut cut-vertices; do
    python3 - proto/vectors/$stream.json > $build/$stream.txt <<'END'
import json, sys
for message in json.load(open(sys.argv[1])):
    lines = [message["surface_hash"]] if message.get("surface_hash") else []
    lines += [" ".join(map(str, [shown["object"], shown["id"], *shown["position_m"]])) for shown in message.get("shown") or []]
    print(len(lines), *lines, sep="\n")
END
done
mono $build/LiveTest.exe http://127.0.0.1:$port proto/vectors/cut.bin $build/cut.txt \
    proto/vectors/cut-vertices.bin $build/cut-vertices.txt
