#!/usr/bin/env bash
# Build the image and run it for real, cut off from the network, on a read-only root; its figures must be those of this
# machine. Starts an engine of its own where none runs; needs root and Debian's packages docker.io and debootstrap, which
# it installs where it can. Skips with one line where that is not possible. Leaves nothing behind.
#
#   docker/check.sh        one cell of the quick profile
#   docker/check.sh all    the whole quick profile
set -euo pipefail
cd "$(dirname "$0")/.."
unset PHYSID_CUBE_TOSSES  # the container does not see them
MOST_MEGABYTES=1600
cells=(--cell "${CELL:-sysid/push_friction}")
if [ "${1:-}" = all ]; then cells=(); fi
IMAGE=physid:check
BASE=physid-base:check
work=$(mktemp -d /tmp/physid-docker.XXXXXX)
chmod 755 "$work"
engine=""

skip() {
    echo "docker check skipped: $1"
    exit 0
}

clean_up() {
    local status=$?
    if [ -n "$engine" ]; then
        kill "$engine" 2>/dev/null && wait "$engine" 2>/dev/null
        # The engine leaves mounts behind, which would keep the folder from being deleted.
        awk -v below="$work/" 'index($2, below) == 1 { print $2 }' /proc/mounts | sort -r | xargs -r umount
    elif [ -n "${client:-}" ]; then
        "${client[@]}" image rm --force "$IMAGE" >/dev/null 2>&1
    fi
    rm -rf "$work"
    exit $status
}
trap clean_up EXIT

find_engine() {
    for client in docker /usr/bin/docker; do
        if "$client" info >/dev/null 2>&1 && builds "$client"; then return; fi
    done
    [ "$(id -u)" = 0 ] || skip "no engine runs, and only root can start one"
    if ! command -v dockerd >/dev/null || ! command -v debootstrap >/dev/null; then
        command -v apt-get >/dev/null || skip "no engine runs, and there is no apt-get to install one"
        { apt-get update && apt-get install -y --no-install-recommends docker.io debootstrap; } >"$work/apt.log" 2>&1 ||
            skip "docker.io and debootstrap cannot be installed: $(tail -n 1 "$work/apt.log")"
    fi
    # No bridge and no firewall rules: neither building nor running needs a network.
    dockerd --data-root "$work/data" --exec-root "$work/exec" --pidfile "$work/pid" --host "unix://$work/socket" \
        --iptables=false --ip6tables=false --bridge=none >"$work/dockerd.log" 2>&1 &
    engine=$!
    export DOCKER_HOST=unix://$work/socket
    for _ in $(seq 60); do
        kill -0 "$engine" 2>/dev/null || { engine=""; skip "dockerd ends at once: $(tail -n 1 "$work/dockerd.log")"; }
        if /usr/bin/docker info >/dev/null 2>&1; then
            client=/usr/bin/docker
            builds "$client" || client=docker
            builds "$client" || skip "no client that can use BuildKit"
            return
        fi
        sleep 0.5
    done
    skip "dockerd does not answer: $(tail -n 1 "$work/dockerd.log")"
}

# A client from 23 on needs the plug-in buildx for BuildKit; without it, it silently falls back to the classic builder.
builds() {
    local major
    major=$("$1" version --format '{{.Client.Version}}' 2>/dev/null | cut -d. -f1)
    [ "${major:-0}" -ge 18 ] && { [ "$major" -lt 23 ] || "$1" buildx version >/dev/null 2>&1; }
}

find_base() {
    local wanted
    wanted=$(sed -n 's/^ARG BASE_IMAGE=//p' docker/cpu.Dockerfile)
    if [ -z "$engine" ] && "$client" pull --quiet "$wanted" >/dev/null 2>&1; then
        BASE=$wanted
        return
    fi
    debootstrap --variant=minbase --include=ca-certificates,python3,python3-venv bookworm "$work/base" \
        >"$work/debootstrap.log" 2>&1 || skip "no base image: $(tail -n 1 "$work/debootstrap.log")"
    tar -C "$work/base" -c --exclude=./var/cache/apt --exclude=./var/lib/apt/lists --exclude='./usr/share/doc/*' \
        --exclude='./usr/share/man/*' --exclude='./usr/share/locale/*' . | "$client" import - "$BASE" >/dev/null
    rm -rf "$work/base"
}

# What the image holds must be what is pinned: a package that constraints-cpu.txt does not name could change unseen.
locked() {
    local loose
    loose=$("$client" run --rm --network none --entrypoint cat "$IMAGE" /opt/venv/installed.txt |
        grep -vixFf constraints-cpu.txt | grep -vE '^(physid @|pip==|wheel==)' || true)
    [ -z "$loose" ] || { echo "in the image, but not in constraints-cpu.txt: $loose"; return 1; }
    echo "packages: all as constraints-cpu.txt pins them"
}

# The services of compose.yaml, where compose is installed: another command, the cells once more (they are there, so that
# it only writes the table again), the page about the runs.
composed() {
    local compose=("$client" compose)
    "${compose[@]}" version >/dev/null 2>&1 || compose=(docker-compose)
    "${compose[@]}" version >/dev/null 2>&1 || { echo "compose: not installed, compose.yaml was not tried"; return; }
    compose+=(--file compose.yaml --project-directory "$work/container")
    export IMAGE
    "${compose[@]}" run --rm physid effects --site contact | grep -q friction
    "${compose[@]}" run --rm reproduce reproduce --profile quick "${cells[@]}" >"$work/composed.txt"
    grep -q "push_friction" "$work/composed.txt"
    "${compose[@]}" run --rm dashboard
    echo "compose: every service runs"
    [ -s "$work/container/runs/dashboard.html" ]
}

docker/wheels.sh >"$work/wheels.log" 2>&1 || skip "no wheel house: $(tail -n 1 "$work/wheels.log")"
if [ -x .venv/bin/hadolint ]; then .venv/bin/hadolint docker/*.Dockerfile && echo "hadolint: clean"; fi
find_engine
find_base
started=$SECONDS
DOCKER_BUILDKIT=1 "$client" build --quiet --network none -f docker/cpu.Dockerfile -t "$IMAGE" \
    --build-arg BASE_IMAGE="$BASE" --build-arg COMMIT="$(git rev-parse HEAD 2>/dev/null || echo unknown)" . >/dev/null
megabytes=$(($("$client" image inspect --format '{{.Size}}' "$IMAGE") / 1000000))
echo "image: $megabytes MB (at most $MOST_MEGABYTES), built without network in $((SECONDS - started)) s"
[ "$megabytes" -le "$MOST_MEGABYTES" ]

locked
IMAGE=$IMAGE DOCKER=$client docker/reproduce.sh effects --site contact >"$work/effects.txt"
grep -q friction "$work/effects.txt" && echo "docker/reproduce.sh: runs another command"

mkdir -m 777 "$work/container" "$work/container/runs" "$work/container/data"
started=$SECONDS
"$client" run --rm --network none --read-only --tmpfs /tmp:exec --cap-drop ALL --security-opt no-new-privileges \
    --volume "$work/container/runs:/app/runs" "$IMAGE" \
    reproduce --profile quick "${cells[@]}" --workers 1 --out runs/reproduce
echo "container: ran as user $(stat -c %u "$work/container/runs/reproduce") in $((SECONDS - started)) s"
composed
started=$SECONDS
OMP_NUM_THREADS=1 WANDB_MODE=offline .venv/bin/physid reproduce --profile quick "${cells[@]}" --workers 1 \
    --out "$work/host/reproduce" >/dev/null
echo "here: ran in $((SECONDS - started)) s"
.venv/bin/python docker/compare.py "$work/host" "$work/container/runs"
