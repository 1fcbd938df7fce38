# Farsight's program on a slim base: docker build -t farsight . && docker run --rm -v "$PWD:/photos" farsight range . --hfov 65 --out boxes
FROM rust:1.95-slim-bookworm AS build
WORKDIR /farsight
COPY . .
RUN cargo build --release --locked --package farsight

FROM debian:bookworm-slim
# ffmpeg reads and writes films; all else is in the program.
RUN apt-get update && apt-get install --yes --no-install-recommends ffmpeg && rm -rf /var/lib/apt/lists/*
COPY --from=build /farsight/target/release/farsight /usr/local/bin/farsight
COPY --from=build /farsight/LICENSE-MIT /farsight/LICENSE-APACHE /farsight/NOTICE /usr/share/doc/farsight/
USER nobody
WORKDIR /photos
ENTRYPOINT ["farsight"]
