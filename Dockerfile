# forcebound in a container, for virtual time and live graphs:
#
#   docker build --tag forcebound .
#   docker run --rm forcebound simulate stiff_wall
#   docker run --rm --cap-add SYS_NICE --ulimit rtprio=99 --ulimit memlock=-1 forcebound launch stiff_wall --duration 10s
#
# The three options permit SCHED_FIFO and locked memory (docs/realtime.md); without them a live graph runs with ordinary
# scheduling and says so. A board at a serial port: --device /dev/ttyACM0 --group-add dialout. The installation has been
# tried in a virtual environment; the image itself has not been built yet. The base is pinned to a version of Python and
# of Debian, not to a digest, which its maintainers may move: for an image that others shall run, put the digest that
# `docker buildx imagetools inspect` prints behind the tag (@sha256:...).
FROM python:3.12.11-slim-bookworm
WORKDIR /forcebound
COPY . .
RUN pip install --no-cache-dir --constraint constraints.txt '.[lab,mesh,mujoco,view]'
RUN useradd --create-home hand
USER hand
WORKDIR /home/hand
ENTRYPOINT ["forcebound"]
