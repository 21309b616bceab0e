# The service in a small image:
#
#   docker build -t chladni .
#   docker run -p 8080:8080 -v chladni:/data -v ./keys:/keys:ro -e CHLADNI_API_KEYS=/keys chladni
#
# The container listens on all its addresses, and there the service asks for API keys: pass a file of them
# (CHLADNI_API_KEYS), or, where something in front of it keeps strangers out, CHLADNI_ALLOW_PUBLIC=true.
# Without either it refuses to start.

FROM rust:1.95-bookworm AS build
WORKDIR /chladni

# Dependencies change rarely: they are built from the manifests alone, and this layer is kept.
COPY Cargo.toml Cargo.lock ./
COPY python/Cargo.toml python/
RUN mkdir src python/src && echo 'fn main() {}' > src/main.rs && touch src/lib.rs python/src/lib.rs \
    && cargo build --release --locked \
    && rm -r src python/src

COPY . .
# The sources may be older than the files that stood in for them.
RUN find src -name '*.rs' -exec touch {} + \
    && cargo build --release --locked --bin chladni

FROM debian:bookworm-slim
RUN useradd --system --uid 10001 --home-dir /data chladni \
    && install --directory --owner chladni --group chladni /data
COPY --from=build /chladni/target/release/chladni /usr/local/bin/chladni

# By number, so that orchestrators can tell that it is not root.
USER 10001
WORKDIR /data
VOLUME /data
ENV CHLADNI_LISTEN=0.0.0.0:8080 \
    CHLADNI_DATABASE=/data/chladni.db
EXPOSE 8080
HEALTHCHECK --interval=30s --timeout=5s --start-period=10s \
    CMD ["chladni", "health", "http://127.0.0.1:8080/livez"]
# The service finishes its answers and hands its jobs back before it ends.
STOPSIGNAL SIGTERM
ENTRYPOINT ["chladni"]
CMD ["serve"]
