#!/bin/sh
# Compiles the package and its sample with mono and tries them against a server; Unity's types are stand-ins (Stubs). Mono is installed where Debian's packages may
# be; what cannot be had is said. `run.sh fuzz` only decodes changed streams, for FUZZ_SECONDS each, and needs no server;
# `run.sh tools` only installs.
set -eu
cd "$(dirname "$0")/../../.."
server=target/debug/kerf-server
build=target/unity

if ! command -v mcs >/dev/null && command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
    apt-get update -qq && apt-get install -qqy --no-install-recommends mono-mcs mono-runtime openssl protobuf-compiler >/dev/null 2>&1 || true
fi
[ "${1:-}" != tools ] || exit 0
for tool in mcs mono openssl protoc python3; do
    command -v $tool >/dev/null || { echo "unity: skipped, there is no $tool here (Debian: mono-mcs mono-runtime openssl protobuf-compiler)"; exit 0; }
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
diff -r -x '*.meta' $build/generated client/unity/Runtime/Client/Generated >$build/generated.diff ||
    { echo "unity: client/unity/Runtime/Client/Generated is not what proto/ says: make unity-protocol"; exit 1; }

mcs -langversion:7.2 -target:library -d:GOOGLE_PROTOBUF_REFSTRUCT_COMPATIBILITY_MODE -warnaserror -nowarn:1591 \
    -r:$build/Google.Protobuf.dll -out:$build/Kerf.Client.dll -recurse:'client/unity/Runtime/Client/*.cs'
mcs -langversion:7.2 -warnaserror -r:$build/Google.Protobuf.dll,$build/Kerf.Client.dll -out:$build/FuzzTest.exe \
    client/unity/Tests~/FuzzTest.cs
mono $build/FuzzTest.exe tests/corpus/views proto/vectors/cut.bin proto/vectors/cut-vertices.bin
[ "${1:-}" != fuzz ] || exit 0
mcs -langversion:7.2 -warnaserror -r:$build/Google.Protobuf.dll,$build/Kerf.Client.dll -out:$build/LiveTest.exe \
    client/unity/Tests~/LiveTest.cs client/unity/Tests~/End.cs
mcs -langversion:7.2 -target:library -warnaserror -nowarn:649 -out:$build/UnityEngine.dll client/unity/Tests~/Stubs/UnityEngine.cs
unity=-r:$build/Google.Protobuf.dll,$build/Kerf.Client.dll,$build/UnityEngine.dll
# The editor writes into fields that nobody here does.
mcs -langversion:7.2 -target:library -warnaserror -nowarn:649,1591 $unity -out:$build/Kerf.Unity.dll -recurse:'client/unity/Runtime/Unity/*.cs'
mcs -langversion:7.2 -target:library -warnaserror -nowarn:1591 $unity,$build/Kerf.Unity.dll -out:$build/Kerf.Editor.dll \
    -recurse:'client/unity/Editor/*.cs'
for input in old new; do
    [ $input = old ] && define= || define=-d:ENABLE_INPUT_SYSTEM
    mcs -langversion:7.2 -warnaserror -nowarn:649 $define $unity,$build/Kerf.Unity.dll,$build/Kerf.Editor.dll \
        -out:$build/SampleTest-$input.exe client/unity/Samples~/Cut/CutSample.cs client/unity/Tests~/SampleTest.cs client/unity/Tests~/Prefab.cs client/unity/Tests~/End.cs
done

# Whatever Unity would import has a .meta with an id of its own: a package from a git address cannot be given any later.
find client/unity/* -not -path '*~*' -not -name '*.meta' | while read -r asset; do
    [ -e "$asset.meta" ] || { echo "unity: $asset has no .meta"; exit 1; }
done
twice=$(find client/unity -name '*.meta' -exec grep -h '^guid: ' {} + | sort | uniq -d)
[ -z "$twice" ] || { echo "unity: two .meta files say $twice"; exit 1; }

port=50071
secured=50072
rm -rf $build/security && mkdir -p $build/security
$server token new --name unity --role driver --file $build/security/tokens.toml --out $build/token
$server serve --listen 127.0.0.1:$port --log-filter error & started=$!
$server serve --listen 127.0.0.1:$secured --security-dir $build/security --log-filter error & started="$started $!"
elsewhere=50070
$server serve --listen 127.0.0.1:$elsewhere --log-filter error & started="$started $!"
authority=$build/authority
client/unity/Tests~/authority.sh $authority
signed=50073
$server serve --listen 127.0.0.1:$signed --security-dir $build/security --log-filter error \
    --set security.certificate_file=$authority/server-chain.pem --set security.key_file=$authority/server.key & started="$started $!"
# Where the certificate is refused nothing is asked: a server that speaks TLS alone is enough.
port_of_shown=$signed
printf '%s\n' "$authority/ca.pem https://localhost:$signed " "$authority/ca.pem https://127.0.0.1:$signed " \
    "$authority/elliptic.pem https://localhost:$signed is not signed by $authority/elliptic.pem" > $authority/cases
while read -r shown file words; do
    port_of_shown=$((port_of_shown + 1))
    openssl s_server -accept 127.0.0.1:$port_of_shown -cert $authority/$shown.pem -key $authority/$shown.key \
        -cert_chain $authority/$shown-chain.pem -www -quiet 2>/dev/null & started="$started $!"
    echo "$authority/$file.pem https://localhost:$port_of_shown $words" >> $authority/cases
done <<END
elsewhere ca the server's certificate is not made out to localhost
forged ca the server's certificate is not signed by
expired ca NotTimeValid
client ca not one for servers
under-server ca the server's certificate is not signed by
under-elliptic elliptic this runtime does not check signatures of elliptic curves
server server-of-elsewhere another certificate than
END
trap 'kill $started 2>/dev/null; wait $started 2>/dev/null || true' EXIT
until $server session --server 127.0.0.1:$secured --ca-file $build/security/certificate.pem health >/dev/null 2>&1; do
    kill -0 ${started#* } || { echo "unity: the server with TLS ended"; exit 1; }
    sleep 0.2
done
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
mono $build/LiveTest.exe http://127.0.0.1:$port https://127.0.0.1:$secured $build/token $build/security/certificate.pem $authority/cases \
    $server http://127.0.0.1:$elsewhere proto/vectors/cut.bin $build/cut.txt \
    proto/vectors/cut-vertices.bin $build/cut-vertices.txt
for input in old new; do
    mono $build/SampleTest-$input.exe http://127.0.0.1:$port client/unity
done
