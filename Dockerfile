# syntax=docker/dockerfile:1
# simwarp with a CPU or a CUDA build of torch; docs/installation.md has the commands.
#   docker build --tag simwarp .
#   docker build --tag simwarp:cuda --build-arg BASE=nvidia/cuda:13.0.1-base-ubuntu24.04 --build-arg TORCH=cuda .
ARG BASE=ubuntu:24.04

FROM ${BASE} AS python
ENV DEBIAN_FRONTEND=noninteractive \
    LANG=C.UTF-8
RUN apt-get update \
    && apt-get install --yes --no-install-recommends ca-certificates python3 python3-venv \
    && rm -rf /var/lib/apt/lists/*

FROM python AS wheel
WORKDIR /source
COPY pyproject.toml setup.py MANIFEST.in README.md LICENSE ./
COPY simwarp simwarp
COPY tasks tasks
COPY train train
RUN python3 -m venv /build \
    && /build/bin/pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python
ARG TORCH=cpu
ARG EXTRAS=viewer
ENV PATH=/opt/simwarp/bin:${PATH} \
    WARP_CACHE_PATH=/cache \
    MPLCONFIGDIR=/tmp/matplotlib \
    PYTHONUNBUFFERED=1
# torch, then what else is required, then simwarp: each layer stays until its own files change
WORKDIR /setup
COPY constraints.txt ./
COPY scripts/setup_env.py scripts/torch_build.py scripts/pip_calls.py scripts/
RUN SIMWARP_TORCH=${TORCH} PIP_NO_CACHE_DIR=1 python3 -m scripts.setup_env --only-torch /opt/simwarp
COPY pyproject.toml ./
COPY scripts/dependencies.py scripts/
RUN python3 -m scripts.dependencies ${EXTRAS} > requirements.txt \
    && pip install --no-cache-dir --constraint /opt/simwarp/constraints.txt --requirement requirements.txt
COPY --from=wheel /wheels /wheels
RUN pip install --no-cache-dir --no-deps /wheels/*.whl
# Kernels that were compiled are kept in a volume; what commands write is in the folder that is mounted at /work.
# Any user may write to both: `docker run --user` names one.
RUN useradd --create-home --shell /bin/bash --uid 1001 simwarp \
    && install --directory --mode 1777 /cache /work
USER simwarp
WORKDIR /work
VOLUME /cache
EXPOSE 8080
ENTRYPOINT ["simwarp"]
CMD ["--help"]
