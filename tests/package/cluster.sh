#!/usr/bin/env bash
# A sweep cut into shards by what clusters have, merged, against the same sweep in one run: cluster.sh slurm|parallel|kubernetes BUILD
# Exit status 77: not installed here, said in words.
set -euo pipefail
by=$1 lab=$(readlink -f "$2")/bin/twoport-lab
cd "$(dirname "$(readlink -f "$0")")/../.."
skip() { echo "skipped: $1"; exit 77; }

work=$(mktemp -d)
daemons=()
stop() {
  [ ${#daemons[@]} -eq 0 ] || kill "${daemons[@]}" 2>/dev/null || true
  wait
  rm -rf "$work"
}
trap stop EXIT
sweep=(scenes/held_spring.textproto --vary 'environment[0].spring.stiffness_n_per_m=500:4000:8'
       --vary control.passivity.method=NONE,FORCE_PROJECTED)

with_parallel() {
  command -v parallel >/dev/null || skip "GNU parallel is not installed (apt-get install parallel)"
  seq 4 | SHARDS=4 TWOPORT_LAB=$lab parallel SHARD={} scripts/sweep_part "$work" "${sweep[@]@Q}"
}

# What Kubernetes gives each pod of an indexed Job: JOB_COMPLETION_INDEX from 0, and the environment of its template.
with_kubernetes() {
  for index in 0 1 2 3; do
    JOB_COMPLETION_INDEX=$index SHARDS=4 TWOPORT_LAB=$lab scripts/sweep_part "$work" "${sweep[@]}"
  done
}

# One node of our own: munge and Slurm as Debian has them, no cgroups, everything in $work.
with_slurm() {
  for tool in munged slurmctld slurmd sbatch; do
    command -v $tool >/dev/null || [ -x /usr/sbin/$tool ] || skip "$tool is not installed (apt-get install slurm-wlm munge)"
  done
  PATH=$PATH:/usr/sbin
  local user port=$((20000 + $$ % 20000))
  user=$(id -un)
  chmod 700 "$work"
  mkdir "$work/state" "$work/spool"
  dd if=/dev/urandom of="$work/munge.key" bs=64 count=1 status=none
  chmod 600 "$work/munge.key"
  cat >"$work/slurm.conf" <<END
ClusterName=one
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmctldPort=$port
SlurmdPort=$((port + 1))
SlurmUser=$user
SlurmdUser=$user
AuthType=auth/munge
AuthInfo=socket=$work/munge.socket
CredType=cred/munge
ProctrackType=proctrack/pgid
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
ReturnToService=2
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd.log
NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
END
  export SLURM_CONF=$work/slurm.conf
  munged --foreground --force --key-file="$work/munge.key" --socket="$work/munge.socket" --pid-file="$work/munged.pid" \
    --log-file="$work/munged.log" --seed-file="$work/munged.seed" >/dev/null 2>&1 &
  daemons+=($!)
  for _ in $(seq 50); do [ -S "$work/munge.socket" ] && break; sleep 0.1; done
  [ -S "$work/munge.socket" ] || skip "munged does not start here: $(tail -n 1 "$work/munged.log" 2>/dev/null)"
  slurmctld -D -i >/dev/null 2>&1 &
  daemons+=($!)
  slurmd -D >/dev/null 2>&1 &
  daemons+=($!)
  for _ in $(seq 200); do [ "$(sinfo -h -o %T 2>/dev/null)" = idle ] && break; sleep 0.1; done
  [ "$(sinfo -h -o %T 2>/dev/null)" = idle ] ||
    skip "Slurm does not start here: $(grep -hi error "$work/slurmctld.log" "$work/slurmd.log" 2>/dev/null | tail -n 1)"
  TWOPORT_LAB=$lab sbatch --wait --export=ALL --array=1-4 --chdir "$PWD" scripts/sweep_part "$work" "${sweep[@]}" ||
    { cat "$work"/part-*/log.txt; exit 1; }
}

"with_$by"
mv "$work/part-3" "$work/lost"
! said=$("$lab" merge "$work"/part-[1-4] --out "$work/merged" 2>&1) || { echo "three of four parts pass for a sweep"; exit 1; }
grep -q -- '--shard 3/4 is not there' <<<"$said" || { echo "$said: does not name the part"; exit 1; }
mv "$work/lost" "$work/part-3"
"$lab" sweep "${sweep[@]}" --plot none --out "$work/whole" >/dev/null
"$lab" merge "$work"/part-[1-4] --out "$work/merged" >/dev/null
cmp "$work/whole/table.csv" "$work/merged/table.csv"
echo "$by: $(($(wc -l <"$work/merged/table.csv") - 1)) cells from 4 parts, the same table as one run"
