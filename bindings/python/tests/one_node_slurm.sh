#!/bin/sh
# Runs a command under a Slurm of this machine alone, which ends with it: for test_slurm.py, as root, on a machine without Slurm.
#
#     apt-get install slurm-wlm
#     sh bindings/python/tests/one_node_slurm.sh target/hosts/bin/python -m pytest bindings/python/tests/test_slurm.py
set -eu
folder=$(mktemp -d)
name=$(hostname -s)
mkdir "$folder/state" "$folder/spool"
SLURM_CONF=$folder/slurm.conf
export SLURM_CONF
cat >"$SLURM_CONF" <<END
ClusterName=one
SlurmctldHost=$name(127.0.0.1)
SlurmUser=root
SlurmctldPort=26817
SlurmdPort=26818
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
MpiDefault=none
NodeName=$name NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES State=UP
END
munge --no-input >/dev/null 2>&1 || {
    install -d -o munge -g munge /run/munge
    su -s /bin/sh munge -c munged
}
slurmctld -i -f "$SLURM_CONF"
slurmd -N "$name" -f "$SLURM_CONF"
# The end is the command's: the daemons, and what ends a job's last step, write into the folder for a moment after they are told.
leave() {
    daemons="$(cat "$folder/slurmd.pid") $(cat "$folder/slurmctld.pid")"
    # shellcheck disable=SC2086
    kill $daemons || true
    for _ in $(seq 100); do
        # shellcheck disable=SC2086
        if ! kill -0 $daemons 2>/dev/null && rm -rf "$folder" 2>/dev/null; then return; fi
        sleep 0.1
    done
}
trap 'ended=$?; leave; exit $ended' EXIT
until sinfo --noheader --states=idle | grep -q idle; do sleep 0.5; done
"$@"
