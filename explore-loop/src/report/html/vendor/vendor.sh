#!/usr/bin/env bash
# Fetches three.js from npm, checks it, and bundles what the page uses into three.min.js: one file, no imports.
# Only needed to move to another version; the build reads the committed file. Needs npm.
set -euo pipefail
cd "$(dirname "$0")"
here=$PWD

three=0.187.0
three_sum=sha512-Qiu7R+Cmh8CstZsY1uJOSWnVlfo7ZtNLV7mF8Jltk3LB3AtDu9cRZlcnRKkAk8Y4z6KKw35z7Y7Urd7jWY8etA==
esbuild=0.28.2
bundle_sum=bdf04fbb700c467c08048db6ea3fd89f8b8ca99db7c9d90bff9e82b77fc1fb70

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
archive=$(npm pack --silent "three@$three")
found=sha512-$(openssl dgst -sha512 -binary "$archive" | openssl base64 -A)
[ "$found" = "$three_sum" ] || { echo "three@$three: checksum $found, expected $three_sum"; exit 1; }
npm install --silent --no-audit --no-fund --ignore-scripts --prefix . "./$archive" "esbuild@$esbuild"

cp "$here/three-parts.js" parts.js
node_modules/.bin/esbuild parts.js --bundle --minify --format=iife --global-name=THREE --target=es2020 \
    --legal-comments=none --banner:js="/* three.js $three, MIT licence, see LICENSE-three.txt */" --outfile=three.min.js --log-level=warning
cp three.min.js "$here/three.min.js"
cp node_modules/three/LICENSE "$here/LICENSE-three.txt"

found=$(sha256sum "$here/three.min.js" | cut -d ' ' -f 1)
[ "$found" = "$bundle_sum" ] || { echo "three.min.js: sha256 $found, expected $bundle_sum"; exit 1; }
