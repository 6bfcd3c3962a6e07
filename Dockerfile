# MarginGuard with ROS 2, 3D Slicer's scene and off-screen rendering. Build in the checkout:
#
#     docker build -t marginguard .
#     docker run --rm marginguard replay package://marginguard/recorded_case
#
# docs/installation.md has more.
FROM python:3.12-slim-bookworm AS builder

RUN apt-get update \
 && apt-get install -y --no-install-recommends g++ \
 && rm -rf /var/lib/apt/lists/*

WORKDIR /source
COPY CHANGELOG.md CITATION.cff CONTRIBUTING.md LICENSE MANIFEST.in README.md constraints.txt pyproject.toml ./
COPY app/ app/
COPY benchmarks/ benchmarks/
COPY data/ data/
COPY examples/ examples/
COPY foxglove/ foxglove/
COPY interfaces/ interfaces/
COPY launch/ launch/
COPY marginguard/ marginguard/
COPY rviz/ rviz/
COPY slicer_module/ slicer_module/
COPY tools/ tools/

# The constraints hold for the packages that build the wheels, too.
ENV PIP_CONSTRAINT=/source/constraints.txt PIP_BUILD_CONSTRAINT=/source/constraints.txt PIP_NO_CACHE_DIR=1
RUN python -m venv /opt/marginguard \
 && /opt/marginguard/bin/pip wheel --no-deps --wheel-dir /wheels . ./interfaces \
 && /opt/marginguard/bin/pip install \
      /wheels/marginguard_interfaces-*.whl "$(ls /wheels/marginguard-*.whl)[ros,scene]"

FROM python:3.12-slim-bookworm AS runtime

# Off-screen OpenGL for pictures and the page.
RUN apt-get update \
 && apt-get install -y --no-install-recommends libegl1 libgl1 libgl1-mesa-dri \
 && rm -rf /var/lib/apt/lists/* \
 && useradd --create-home --shell /usr/sbin/nologin marginguard

# Owned by the user, so that the kernels that the first command compiles are kept beside the code.
COPY --from=builder --chown=marginguard:marginguard /opt/marginguard /opt/marginguard
ENV PATH=/opt/marginguard/bin:$PATH

USER marginguard
WORKDIR /home/marginguard
ENTRYPOINT ["marginguard"]
CMD ["--help"]
