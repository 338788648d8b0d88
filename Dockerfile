# docker build -t stickslip . && docker run --rm -v "$PWD/results:/stickslip/results" stickslip run block
#
# The image was not built: there was no Docker. Its commands (these packages, then `make install`) pass in a root of
# Debian 13 made by debootstrap; `make debian13` does that. Not debian:trixie-slim: it leaves out /usr/share/doc, where
# the STEP file of the scene `cad_part` is.
FROM debian:trixie
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates git make
WORKDIR /stickslip
COPY . .
RUN make install
ENV PATH=/stickslip/.venv/bin:$PATH OMP_NUM_THREADS=1 PYTHONNOUSERSITE=1
ENTRYPOINT ["stickslip"]
CMD ["--help"]
