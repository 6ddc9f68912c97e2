#!/bin/bash
# Starts a Slurm of one machine in the folder $1: munge, controller and node, with keys, state and logs of its own there.
# Prints the path of its slurm.conf. Exit code 77, with the reason, where that cannot be.
# Its processes end with `stop.sh` and the same folder.
set -eu
folder=$1
mkdir -p "$folder"

missing() {
  echo "$1" >&2
  exit 77
}

if ! command -v slurmctld > /dev/null || ! command -v munged > /dev/null; then
  [ "$(id -u)" -eq 0 ] || missing "no slurmctld or munged, and only root can install them"
  command -v apt-get > /dev/null || missing "no slurmctld or munged, and no apt-get to install them with"
  { apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends slurm-wlm munge; } \
    > "$folder/install.log" 2>&1 || missing "slurm-wlm and munge cannot be installed"
fi

umask 077
head -c 1024 /dev/urandom > "$folder/munge.key"
munged --force --key-file="$folder/munge.key" --socket="$folder/munge.socket" --pid-file="$folder/munged.pid" \
  --log-file="$folder/munged.log" --seed-file="$folder/munged.seed" || missing "munged does not start"

port() { python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'; }
host=$(hostname -s)
cat > "$folder/slurm.conf" << CONF
ClusterName=hksl
SlurmctldHost=$host(127.0.0.1)
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
SlurmctldPort=$(port)
SlurmdPort=$(port)
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
CryptoType=crypto/munge
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
JobRequeue=1
ReturnToService=2
SchedulerParameters=sched_interval=1
RequeueExit=
MinJobAge=300
KillWait=30
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
sed -i '/^RequeueExit=$/d' "$folder/slurm.conf"
mkdir -p "$folder/state" "$folder/spool"
export SLURM_CONF="$folder/slurm.conf"
slurmctld || missing "slurmctld does not start: $(tail -1 "$folder/slurmctld.log")"
slurmd || missing "slurmd does not start: $(tail -1 "$folder/slurmd.log")"
for _ in $(seq 100); do
  if sinfo --noheader --format=%T 2> /dev/null | grep -q idle; then
    echo "$SLURM_CONF"
    exit 0
  fi
  sleep 0.2
done
missing "the node does not come up: $(tail -1 "$folder/slurmd.log")"
