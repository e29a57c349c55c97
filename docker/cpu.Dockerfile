# physid for the CPU.
#
#   docker build -f docker/cpu.Dockerfile -t physid:cpu .
#
# Without network: fill docker/wheelhouse (docker/wheels.sh), name a base that is there already, and build with
# --network none. BuildKit is needed (the default since Docker 23; before, DOCKER_BUILDKIT=1).
ARG BASE_IMAGE=python:3.11.14-slim-bookworm

FROM ${BASE_IMAGE} AS build
ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu
ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1
RUN python3 -m venv /opt/venv
WORKDIR /build
COPY pyproject.toml constraints-cpu.txt README.md LICENSE ./
COPY configs configs
COPY src src
# Wheels from the house if it is filled, else from the net; setuptools only for the build, pip not at all in the image.
RUN --mount=type=bind,target=/context \
    if ls /context/docker/wheelhouse/*.whl >/dev/null 2>&1; \
    then set -- --no-index --find-links /context/docker/wheelhouse; \
    else set -- --extra-index-url "${TORCH_INDEX}"; fi && \
    /opt/venv/bin/pip install "$@" -c constraints-cpu.txt "setuptools>=77" wheel && \
    /opt/venv/bin/pip install "$@" -c constraints-cpu.txt --no-build-isolation . && \
    /opt/venv/bin/pip freeze --all > /opt/venv/installed.txt && \
    /opt/venv/bin/pip uninstall --yes --quiet wheel setuptools pip
# What no run reads: tests of other packages, headers, PyBullet's robots and meshes, its renderer for GPUs.
RUN find /opt/venv/lib -depth \( -name __pycache__ -o -type d -name tests -o -path '*/torch/test' \
    -o -path '*/torch/include' -o -path '*/torch/bin/*' -not -name torch_shm_manager -o -name 'eglRenderer*.so' \
    -o -path '*/site-packages/pybullet_data' -o -path '*/site-packages/pybullet_envs' \
    -o -path '*/site-packages/pybullet_robots' -o -path '*/site-packages/pybullet_examples' \) -exec rm -r {} +

FROM ${BASE_IMAGE}
ARG COMMIT=unknown
LABEL org.opencontainers.image.title="physid" \
      org.opencontainers.image.licenses="MIT" \
      org.opencontainers.image.revision="${COMMIT}"
# Everything that is written at run time lies in mounted folders or /tmp: the image runs read-only, as any user.
ENV PATH=/opt/venv/bin:${PATH} \
    HOME=/tmp \
    MPLCONFIGDIR=/tmp/matplotlib \
    OMP_NUM_THREADS=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    WANDB_MODE=offline \
    PHYSID_COMMIT=${COMMIT}
RUN groupadd --gid 1000 physid && useradd --uid 1000 --gid 1000 --home-dir /app --create-home physid
WORKDIR /app
COPY --from=build /opt/venv /opt/venv
RUN install --directory --owner physid --group physid data runs
USER 1000:1000
ENTRYPOINT ["physid"]
CMD ["reproduce", "--profile", "quick"]
