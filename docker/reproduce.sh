#!/usr/bin/env bash
# Build the image where it is missing, and run physid in it, cut off from the network, on the folders data and runs:
#
#   docker/reproduce.sh                                   the quick reproduction of the paper
#   docker/reproduce.sh reproduce --cell sysid/push_mass  any other command of physid
#
# IMAGE names another image, DOCKER another client.
set -euo pipefail
cd "$(dirname "$0")/.."
DOCKER=${DOCKER:-docker}
IMAGE=${IMAGE:-physid:cpu}
if ! "$DOCKER" image inspect "$IMAGE" >/dev/null 2>&1; then
    commit=$(git rev-parse HEAD 2>/dev/null || echo unknown)
    DOCKER_BUILDKIT=1 "$DOCKER" build -f docker/cpu.Dockerfile -t "$IMAGE" --build-arg COMMIT="$commit" .
fi
# Never as root: where root calls, the image's own user runs, and the two folders become its own.
user=$(id -u):$(id -g)
if [ "$user" = 0:0 ]; then
    user=1000:1000
    install --directory --owner 1000 --group 1000 data runs
fi
mkdir -p data runs
if [ $# -eq 0 ]; then set -- reproduce --profile quick; fi
exec "$DOCKER" run --rm --network none --read-only --tmpfs /tmp:exec --user "$user" \
    --cap-drop ALL --security-opt no-new-privileges --pids-limit 512 \
    --volume "$PWD/data:/app/data" --volume "$PWD/runs:/app/runs" "$IMAGE" "$@"
