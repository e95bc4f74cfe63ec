#!/usr/bin/env bash
# Installs what is missing, and only that; running it again does nothing.
#
#   scripts/setup.sh build   what building the tool takes: Cargo and a C compiler (it also links)
#   scripts/setup.sh test    (default) also a Vulkan driver for the tests on the GPU: without one, Mesa's software driver is installed;
#                            and a virtual screen (Xvfb) with the X11 libraries that a window loads
#
# No development packages: X11, Wayland and Vulkan are loaded when a program starts, sound is not used.
# Debian and Ubuntu are served through apt-get; elsewhere the script says what to install.
set -euo pipefail

want=${1:-test}
case $want in
    build | test) ;;
    *)
        echo "usage: scripts/setup.sh [build|test]" >&2
        exit 2
        ;;
esac

say() { echo "setup: $*" >&2; }

# A rustup installation whose profile nobody has sourced yet.
if ! command -v cargo >/dev/null && [ ! -x "${CARGO_HOME:-$HOME/.cargo}/bin/cargo" ]; then
    say "Cargo is missing. Install Rust 1.95 or later from https://rustup.rs, then run this again."
    exit 1
fi

# True where the Vulkan loader and at least one driver are there.
vulkan_is_there() {
    [ "$(uname -s)" = Linux ] || return 0 # Metal and Direct3D come with the system
    local ldconfig loader=no folder
    ldconfig=$(command -v ldconfig || echo /sbin/ldconfig)
    if "$ldconfig" -p 2>/dev/null | grep -F libvulkan.so.1 >/dev/null; then
        loader=yes
    fi
    [ $loader = yes ] || return 1
    [ -z "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}" ] || return 0
    for folder in /usr/share/vulkan /usr/local/share/vulkan /etc/vulkan "${XDG_DATA_HOME:-$HOME/.local/share}/vulkan"; do
        if compgen -G "$folder/icd.d/*.json" >/dev/null; then
            return 0
        fi
    done
    return 1
}

# True where a window can open on a virtual screen.
screen_is_there() {
    [ "$(uname -s)" = Linux ] || return 0 # tests with a window run on Linux alone
    command -v Xvfb >/dev/null || return 1
    local ldconfig library
    ldconfig=$(command -v ldconfig || echo /sbin/ldconfig)
    for library in libX11.so.6 libX11-xcb.so.1 libXcursor.so.1 libXi.so.6 libxkbcommon-x11.so.0; do
        "$ldconfig" -p 2>/dev/null | grep -F "$library" >/dev/null || return 1
    done
}

packages=()
if ! command -v cc >/dev/null && ! command -v gcc >/dev/null && ! command -v clang >/dev/null; then
    packages+=(gcc libc6-dev)
elif ! command -v cc >/dev/null; then
    # Rust links by calling `cc`.
    say "there is a C compiler, but it is not called cc: set CARGO_TARGET_<TRIPLE>_LINKER, or install gcc."
    packages+=(gcc libc6-dev)
fi
if [ "$want" = test ] && ! vulkan_is_there; then
    packages+=(libvulkan1 mesa-vulkan-drivers)
fi
if [ "$want" = test ] && ! screen_is_there; then
    packages+=(xvfb libx11-6 libx11-xcb1 libxcursor1 libxi6 libxkbcommon-x11-0)
fi

if [ ${#packages[@]} -eq 0 ]; then
    exit 0
fi

if ! command -v apt-get >/dev/null; then
    say "missing: ${packages[*]} (Debian's names). There is no apt-get here; install the same with your package manager:"
    say "  Fedora        dnf install gcc vulkan-loader mesa-vulkan-drivers xorg-x11-server-Xvfb libX11 libXcursor libXi libxkbcommon-x11"
    say "  Arch          pacman -S gcc vulkan-icd-loader vulkan-swrast xorg-server-xvfb libx11 libxcursor libxi libxkbcommon-x11"
    say "  macOS         xcode-select --install"
    exit 1
fi

as_root=()
if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
        say "missing: ${packages[*]}. Install them as root: apt-get install ${packages[*]}"
        exit 1
    fi
    # Without a terminal nobody can type a password: fail at once and not by waiting.
    if [ -t 0 ]; then as_root=(sudo); else as_root=(sudo -n); fi
fi
say "installing ${packages[*]}"
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -q >&2
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -q -y --no-install-recommends "${packages[@]}" </dev/null >&2

if [ "$want" = test ] && ! vulkan_is_there; then
    say "the packages are installed, but no Vulkan driver was found."
    exit 1
fi
if [ "$want" = test ] && ! screen_is_there; then
    say "the packages are installed, but Xvfb or a library of X11 was not found."
    exit 1
fi
