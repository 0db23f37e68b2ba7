#!/usr/bin/env bash
# Run a command on a kernel of its own that has V4L2 and vivid: User Mode Linux, an ordinary program.
#
#   CELLCTL_KERNEL=/path/to/linux tests/kernel/boot.sh COMMAND...
#
# Exit code: the command's; 125 if the kernel did not run it. The command runs in this folder and sees
# this computer's files, read-only under a layer that is thrown away. Needs busybox, linked statically.
# The kernel has built in: vivid, hostfs, overlayfs, tmpfs, devtmpfs, proc, sysfs, unix sockets.
set -euo pipefail
fail() { echo "boot.sh: $*" >&2; exit 125; }
[ $# -gt 0 ] || fail 'no command'
kernel=${CELLCTL_KERNEL:-}
[ -x "$kernel" ] || fail "CELLCTL_KERNEL: \`$kernel\` is no program; name a User Mode Linux with vivid built in"
busybox=$(command -v busybox) && ! ldd "$busybox" >/dev/null 2>&1 || fail 'needs busybox, linked statically'
job=$(mktemp -d)
trap 'rm -rf "$job"' EXIT
{
  for name in PATH HOME LANG PYTHONPATH PYTHONDONTWRITEBYTECODE; do
    [ -z "${!name-}" ] || printf 'export %s=%q\n' "$name" "${!name}"
  done
  printf 'cd %q\nexec' "$PWD"
  printf ' %q' "$@"
  echo
} >"$job/command"
cat >"$job/init" <<INIT
#!$busybox sh
run() { $busybox "\$@"; }
run mount -t proc proc /proc
run mount -t tmpfs -o size=70% layer /mnt
run mkdir -p /mnt/upper /mnt/work /mnt/root
root=/mnt/root
run mount -t overlay whole \$root -o lowerdir=/,upperdir=/mnt/upper,workdir=/mnt/work
for one in proc sysfs:sys devtmpfs:dev; do run mount -t \${one%:*} \${one%:*} \$root/\${one#*:}; done
run mkdir -p \$root/dev/pts \$root/dev/shm \$root$job
run mount -t devpts pts \$root/dev/pts
run mount -t tmpfs shm \$root/dev/shm
run ln -sf /proc/self/fd \$root/dev/fd
run mount -t hostfs job \$root$job -o $job
run ip link set lo up
run chroot \$root /bin/bash $job/command </dev/null >\$root$job/output 2>&1
echo \$? >\$root$job/code
run poweroff -f
INIT
chmod +x "$job/init"
parameters=()
for one in n_devs=1 node_types=0x1 num_inputs=1 input_types=0x0 multiplanar=1; do parameters+=("vivid.$one"); done
"$kernel" mem=1536M root=none rootfstype=hostfs rootflags=/ ro "init=$job/init" con=null con0=null,null quiet loglevel=1 \
  "${parameters[@]}" </dev/null >"$job/kernel" 2>&1 || true
[ ! -e "$job/output" ] || cat "$job/output"
[ -s "$job/code" ] || { tail -5 "$job/kernel" >&2; fail 'the kernel stopped before the command ended'; }
exit "$(cat "$job/code")"
