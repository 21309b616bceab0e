#!/usr/bin/env bash
# How much faster two nodes are than one, and how long a job waits: `benches/nodes.sh [jobs] [points]`, on an idle machine with the
# programs of PostgreSQL. Each node computes with one thread; a job takes about a second.
set -euo pipefail
cd "$(dirname "$0")/.."
jobs=${1:-40}
points=${2:-6000}
chladni=${CHLADNI:-target/release/chladni}
programs=$(ls -d /usr/lib/postgresql/*/bin | sort -V | tail -n 1)
folder=$(mktemp -d)
chmod 755 "$folder"
nodes=()
as_postgres() { if [ "$(id -u)" = 0 ]; then (cd / && runuser -u postgres -- "$@"); else "$@"; fi; }
finish() {
    for node in "${nodes[@]}"; do kill "$node" 2> /dev/null || true; done
    as_postgres "$programs/pg_ctl" -D "$folder/pg/data" -m immediate stop > /dev/null 2>&1 || true
    rm -rf "$folder"
}
trap finish EXIT

mkdir "$folder/pg"
if [ "$(id -u)" = 0 ]; then chown postgres "$folder/pg"; fi
as_postgres "$programs/initdb" -A trust -U postgres -E UTF8 --locale=C -D "$folder/pg/data" > /dev/null
as_postgres "$programs/pg_ctl" -D "$folder/pg/data" -w -l "$folder/pg/log" \
    -o "-k $folder/pg -c listen_addresses=''" start > /dev/null
sql() { "$programs/psql" -qAtX -h "$folder/pg" -U postgres "$@"; }

start() { # name, database, flags
    local name=$1 database=$2
    shift 2
    "$chladni" serve --listen 127.0.0.1:0 --threads 1 --disk-floor 0 --database "$database" "$@" \
        > "$folder/$name.out" 2> "$folder/$name.log" &
    nodes+=($!)
    for _ in $(seq 100); do
        address=$(grep -o 'http://[^ ]*' "$folder/$name.out" | head -n 1) && [ -n "$address" ] && break
        sleep 0.1
    done
}
stop() { for node in "${nodes[@]}"; do kill "$node"; wait "$node" 2> /dev/null || true; done; nodes=(); }

for seed in $(seq "$jobs"); do
    "$chladni" sample sphere --points $((points + seed)) -o "$folder/$seed.npy" > /dev/null
done
submit_all() {
    for seed in $(seq "$jobs"); do
        curl -sf -T "$folder/$seed.npy" "$address/clouds?bases=60&operator=voronoi" > "$folder/$seed.json"
    done
}
seconds_for_all() { # by the records of the jobs: from the first start to the last end
    "$1" "SELECT round((max(finished) - min(started)) / 1000.0, 2) FROM jobs"
}
wait_for_all() { until [ "$("$1" "SELECT count(*) FROM jobs WHERE state IN ('queued', 'running')")" = 0 ]; do sleep 0.2; done; }

for count in 1 2; do
    sql -c "CREATE DATABASE of_$count"
    address_of_database="postgresql:///of_$count?host=$folder/pg&user=postgres"
    in_database() { sql -d "of_$count" -c "$1"; }
    start queue "$address_of_database" --workers 0
    submit_all
    for node in $(seq "$count"); do
        "$chladni" serve --no-listen --threads 1 --database "$address_of_database" > /dev/null 2> "$folder/$node.log" &
        nodes+=($!)
    done
    wait_for_all in_database
    echo "$count node(s) on PostgreSQL: $jobs jobs in $(seconds_for_all in_database) s"
    stop
done

# From submission to start, one job at a time, on an idle node.
latency() { # name, database, flags
    start "$@"
    for seed in $(seq "$jobs"); do
        id=$(curl -sf -T "$folder/$seed.npy" "$address/clouds?bases=4&operator=voronoi&tolerance=1e-3" |
            grep -o '"id":"[^"]*"' | tail -n 1 | cut -d '"' -f 4)
        curl -sf "$address/jobs/$id?wait=60" > "$folder/$seed.json"
    done
    curl -s "$address/metrics" | grep chladni_job_queue_seconds_bucket | sed 's/^/    /'
    stop
}
echo 'From submission to start, SQLite:'
latency sqlite "$folder/one.db"
echo 'From submission to start, PostgreSQL:'
sql -c 'CREATE DATABASE idle'
latency postgres "postgresql:///idle?host=$folder/pg&user=postgres"
