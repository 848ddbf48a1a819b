#!/bin/sh
# Makes an authority and certificates in a folder: one that it has signed for a server, by way of another, and such as no
# client may take. authority.sh FOLDER
set -eu
mkdir -p "$1"
cd "$1"

rsa="rsa:2048"
elliptic="ec -pkeyopt ec_paramgen_curve:prime256v1"

# authority NAME SUBJECT KEY: one that signs itself.
authority() {
    openssl req -x509 -newkey $3 -nodes -keyout "$1.key" -out "$1.pem" -days 2 -subj "/CN=$2" \
        -addext basicConstraints=critical,CA:TRUE -addext keyUsage=critical,keyCertSign 2>/dev/null
}

# signed NAME KEY BY EXTENSIONS [DATES]: one that another has signed.
signed() {
    openssl req -new -newkey $2 -nodes -keyout "$1.key" -out "$1.csr" -subj "/CN=$1" 2>/dev/null
    printf '%s\n' "$4" | tr ';' '\n' > "$1.extensions"
    openssl x509 -req -in "$1.csr" -CA "$3.pem" -CAkey "$3.key" -CAcreateserial -out "$1.pem" -extfile "$1.extensions" \
        ${5:--days 2} 2>/dev/null
    cat "$1.pem" "$3.pem" > "$1-chain.pem"
}

server="basicConstraints=critical,CA:FALSE;extendedKeyUsage=serverAuth"
here="subjectAltName=DNS:localhost,IP:127.0.0.1"

authority ca "an authority" $rsa
# The same name, another key.
authority pretender "an authority" $rsa
authority elliptic "an elliptic authority" "$elliptic"
signed between $rsa ca "basicConstraints=critical,CA:TRUE;keyUsage=critical,keyCertSign"

signed server "$elliptic" between "$server;$here"
signed elsewhere "$elliptic" ca "$server;subjectAltName=DNS:elsewhere.example,DNS:*.localhost,IP:127.0.0.2"
signed forged "$elliptic" pretender "$server;$here"
signed expired "$elliptic" ca "$server;$here" "-days -1"
signed client "$elliptic" ca "basicConstraints=critical,CA:FALSE;extendedKeyUsage=clientAuth;$here"
signed server-of-elsewhere $rsa ca "$server;subjectAltName=DNS:elsewhere.example"
# Signed by who has a certificate of the authority, but is none.
signed under-server "$elliptic" server-of-elsewhere "$server;$here"
signed under-elliptic "$elliptic" elliptic "$server;$here"
