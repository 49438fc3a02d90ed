# Sinew in a container: the command, the library and the dashboard, from the locked requirements.
#   docker build -t sinew .
#   docker run --rm -v "$PWD/out:/lab/out" sinew reproduce --out out/paper
# A bench: add --device /dev/ttyUSB0. The dashboard listens to the container's own loopback alone, so it needs the
# host's network: docker run --rm --network host -v "$PWD/runs:/lab/runs" sinew serve --emulate --runs runs
FROM python:3.12-slim
WORKDIR /opt/sinew
COPY requirements-serve.txt ./
RUN python -m pip install --no-cache-dir --require-hashes --only-binary :all: -r requirements-serve.txt
# No history comes along: --build-arg VERSION=0.1.0 tells which version it is.
ARG VERSION=0+container
ENV SETUPTOOLS_SCM_PRETEND_VERSION=${VERSION}
COPY pyproject.toml README.md LICENSE ./
COPY src src
RUN python -m pip install --no-cache-dir --no-deps --no-build-isolation . && useradd --create-home lab && install -d -o lab /lab
USER lab
WORKDIR /lab
ENTRYPOINT ["sinew"]
CMD ["--help"]
