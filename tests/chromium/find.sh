#!/bin/bash
# Prints the path of a Chromium; installs Debian's where there is none, with its log in the folder $1.
# Exit code 77, with the reason, where that cannot be. Several may run at once.
set -eu
folder=$1
mkdir -p "$folder"

missing() {
  echo "$1" >&2
  exit 77
}

# One in a snap sees neither our temporary folders nor our pipes, and Ubuntu's package is a mere pointer to it.
find_chromium() {
  local name path version
  for name in chromium chromium-browser google-chrome; do
    path=$(command -v "$name") && version=$("$path" --version 2> /dev/null) || continue
    case $version in
      *snap*) ;;
      *[0-9].[0-9]*) echo "$path" && return ;;
    esac
  done
  return 1
}

find_chromium && exit
[ "$(id -u)" -eq 0 ] || missing "no Chromium, and only root can install it"
command -v apt-get > /dev/null || missing "no Chromium, and no apt-get to install it with"

# apt-get waits for nobody while it reads the lists: we wait for each other, on a folder that every apt has.
exec 9< /var/lib/apt
flock 9
find_chromium && exit
{ apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
  -o DPkg::Lock::Timeout=300 chromium fonts-dejavu-core; } > "$folder/install.log" 2>&1 9<&- \
  || missing "Chromium cannot be installed: $(tail -n 1 "$folder/install.log")"
find_chromium || missing "the Chromium that apt-get installed does not start"
