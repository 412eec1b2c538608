# Images of zengrid. IMAGE=market (the default): clock, agents, gateway, spawner. IMAGE=learn: also what trains and learns
# (torch), PV models of sites, figures, reference solutions.
#
# Plain Dockerfile syntax: builds with and without BuildKit. Where packages come from can be changed as with any pip:
#   docker build --build-arg IMAGE=learn --build-arg BASE=python:3.12-slim --build-arg PIP_EXTRA_INDEX_URL=... .
ARG BASE=python:3.11-slim

FROM ${BASE} AS builder
ARG PIP_INDEX_URL
ARG PIP_EXTRA_INDEX_URL
ARG PIP_FIND_LINKS
ARG PIP_CERT
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
RUN command -v strip >/dev/null \
    || { apt-get update -qq && apt-get install -y -qq --no-install-recommends binutils >/dev/null; }
# pip stays here: it installs into an environment that has none.
RUN python3 -m venv /opt/pip && python3 -m venv --without-pip /opt/zengrid
WORKDIR /src
COPY pyproject.toml constraints.txt ./
COPY deploy/docker/requirements.py deploy/docker/
ENV PIP="/opt/pip/bin/pip --python /opt/zengrid/bin/python install --quiet --no-compile --constraint constraints.txt"

# Dependencies first: they change less often than the code.
ARG IMAGE=market
RUN python3 deploy/docker/requirements.py $IMAGE >requirements.txt && $PIP -r requirements.txt
COPY deploy/docker/slim.sh deploy/docker/
RUN [ $IMAGE != market ] || sh deploy/docker/slim.sh /opt/zengrid
COPY . .
RUN $PIP --no-deps . && /opt/zengrid/bin/python deploy/docker/warm.py

FROM ${BASE}
# The same numbers everywhere, so that a volume keeps its owner.
RUN groupadd --gid 10001 zengrid && useradd --uid 10001 --gid 10001 --create-home --home-dir /home/zengrid zengrid \
    && mkdir /data /tokens && chown zengrid:zengrid /data /tokens
ENV PATH=/opt/zengrid/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    XDG_STATE_HOME=/data
COPY --from=builder /opt/zengrid /opt/zengrid
WORKDIR /data
USER 10001:10001
VOLUME /data
ENTRYPOINT ["zengrid"]
CMD ["--help"]
