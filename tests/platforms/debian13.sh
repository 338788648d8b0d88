#!/usr/bin/env bash
# Debian 13 on a machine with another Debian: in a root of its own, `make run`, some 80 tests, and the figures of ten
# scenes beside this machine's, on the same meshes. The first time it takes minutes and 3.9 GB; the root is kept in
# build/debian13, or where DEBIAN13 says. Where there is no root (the user) or no debootstrap, it says so and leaves it out.
set -euo pipefail
cd "$(dirname "$0")/../.."
root=$(realpath -m "${DEBIAN13:-build/debian13}") figures=build/platforms
tests=(tests/unit/test_{axisymmetric,nested_mesh,rows,step_files,volume}.py
    tests/runs/test_script.py)

left_out() { echo "Debian 13 is left out: $*"; exit 0; }
! grep -q '^VERSION_CODENAME=trixie' /etc/os-release || left_out "this machine has it"
[ "$(id -u)" = 0 ] || left_out "it needs the user root"
command -v debootstrap >/dev/null || left_out "it needs Debian's package debootstrap"
unshare --mount true 2>/dev/null || left_out "nothing can be mounted here, as in most containers"

if [ ! -d "$root" ]; then
    rm -rf "$root.part" # an earlier try, interrupted
    mkdir -p "$(dirname "$root")"
    debootstrap --variant=minbase --include=ca-certificates,git,make trixie "$root.part" >"$root.log" ||
        { tail -3 "$root.log" >&2; exit 1; }
    mv "$root.part" "$root"
fi

# the files as they are here, committed or not; .venv and build stay
mkdir -p "$root/stickslip/$figures"
find "$root/stickslip" -mindepth 1 -maxdepth 1 ! -name .venv ! -name build -exec rm -rf {} +
git ls-files -z --cached --others --exclude-standard | xargs -0 ls -d 2>/dev/null | tar -cT - | tar -xC "$root/stickslip"

rm -rf "$figures"
.venv/bin/python -m stickslip.workflows.lab.benchmarks.platforms "$figures" here
cp "$figures"/* "$root/stickslip/$figures"

# mounts of a namespace of its own end with it
unshare --mount bash -euo pipefail -s "$root" "${tests[@]}" <<'INSIDE'
root=$1
shift
mount -t proc proc "$root/proc"
mount --rbind /dev "$root/dev"
mount --rbind /sys "$root/sys"
for file in /etc/resolv.conf /etc/ssl/certs/ca-certificates.crt; do # the network as this machine reaches it
    [ ! -s $file ] || { [ -e "$root$file" ] || touch "$root$file"; mount --bind "$(realpath $file)" "$root$file"; }
done
chroot "$root" env -u PYTHONPATH -u VIRTUAL_ENV HOME=/root LANG=C.UTF-8 OMP_NUM_THREADS=1 PYTHONNOUSERSITE=1 \
    PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin bash -euo pipefail -c '
        cd /stickslip
        make run
        .venv/bin/python -m pytest -q -n 2 -p no:cacheprovider "$@"
        .venv/bin/python -m stickslip.workflows.lab.benchmarks.platforms build/platforms there
    ' inside "$@"
INSIDE
