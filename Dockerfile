# hotice on the CPU: docker build -t hotice . && docker run --rm -v "$PWD/out:/out" hotice play --scene beam --out /out/beam.html
# (out: a folder that user 1000 may write; Docker would make a missing one as root's)
FROM python:3.11-slim
RUN useradd --create-home hotice
WORKDIR /src
# PyTorch without CUDA comes from its own index, at the version that was tested
COPY constraints.txt pyproject.toml README.md LICENSE NOTICE MANIFEST.in ./
COPY hotice hotice
RUN pip install --no-cache-dir -c constraints.txt --extra-index-url https://download.pytorch.org/whl/cpu . \
    && rm -rf /src
WORKDIR /home/hotice
USER hotice
# compiled once, into the image; MuJoCo needs no window
ENV MUJOCO_GL=disable OMP_NUM_THREADS=1
RUN hotice warm
ENTRYPOINT ["hotice"]
CMD ["--help"]
