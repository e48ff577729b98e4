#!/usr/bin/env bash
# Fetches Debian's rustc-web with the sources of its standard library into a folder, for machines on
# which rustup cannot add the target wasm32-unknown-unknown, and prints what names it to the builder
# of the player:
#
#   eval "$(tools/web-player/debian-rustc.sh /tmp/rustc-web)"
#
# Nothing is installed: the packages (some 135 MB) are unpacked in the folder alone.
set -euo pipefail

if [ $# -ne 1 ]; then
    echo "usage: debian-rustc.sh FOLDER" >&2
    exit 2
fi
for program in apt-get apt-cache dpkg; do
    if ! command -v "$program" >/dev/null; then
        echo "debian-rustc.sh: $program is missing; on other systems run: rustup target add wasm32-unknown-unknown" >&2
        exit 1
    fi
done
mkdir -p "$1"
folder=$(cd "$1" && pwd)

if [ ! -x "$folder/rustc" ]; then
    # The names of its libraries hold versions, which change with Debian's browsers.
    depends() { apt-cache depends --no-recommends --no-suggests --no-conflicts --no-breaks --no-replaces --no-enhances "$1" |
        awk '$1 == "Depends:" || $1 == "PreDepends:" { print $2 }'; }
    if ! apt-cache show rustc-web >/dev/null 2>&1; then apt-get update >&2; fi
    std=$(depends libstd-rust-web-dev | grep -m1 '^libstd-rust-web-[0-9]')
    llvm=$(depends "$std" | grep -m1 '^libllvm')
    mkdir -p "$folder/debs"
    (cd "$folder/debs" && apt-get download rustc-web "$std" libstd-rust-web-dev "$llvm" rust-web-src >&2)
    for package in "$folder"/debs/*.deb; do dpkg -x "$package" "$folder"; done
    rm -r "$folder/debs"

    mkdir -p "$folder/usr/lib/rustlib/src"
    ln -sfn "$(echo "$folder"/usr/src/rustc-*)" "$folder/usr/lib/rustlib/src/rust"
    libraries=$(find "$folder/usr/lib" -name '*.so*' -printf '%h\n' | sort -u | paste -sd:)
    cat >"$folder/rustc.part" <<WRAPPER
#!/bin/sh
LD_LIBRARY_PATH="$libraries\${LD_LIBRARY_PATH:+:\$LD_LIBRARY_PATH}" exec "$folder/usr/bin/rustc" "\$@"
WRAPPER
    chmod +x "$folder/rustc.part"
    mv "$folder/rustc.part" "$folder/rustc"
fi
"$folder/rustc" --version >&2
printf 'export WM_WASM_RUSTC=%q\n' "$folder/rustc"
