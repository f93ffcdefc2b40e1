# docker build -t workbench .
# docker run --rm --user "$(id -u)" -v "$PWD:/work" workbench check actuator.fmu --report health.html
FROM python:3.13-slim AS build
COPY . /source
RUN python -m venv /opt/workbench
RUN /opt/workbench/bin/python -m pip install --quiet --no-cache-dir /source
# What fmpy asks for and nobody imports, and what is not needed any more.
RUN /opt/workbench/bin/python -m pip uninstall --quiet --yes cmake pip

FROM python:3.13-slim
COPY --from=build /opt/workbench /opt/workbench
RUN useradd --create-home workbench
USER workbench
WORKDIR /work
ENTRYPOINT ["/opt/workbench/bin/workbench"]
