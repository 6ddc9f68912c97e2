#!/bin/bash
# Ends what start.sh has started in the folder $1.
for name in slurmd slurmctld munged; do
  if [ -f "$1/$name.pid" ]; then
    kill "$(cat "$1/$name.pid")" 2> /dev/null || true
  fi
done
