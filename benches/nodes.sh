#!/usr/bin/env bash
# How much faster two nodes are than one, how long a job waits, and how many are claimed in a second:
# `benches/nodes.sh [jobs] [points] [bases]`, on an idle machine with the programs of PostgreSQL and Python. Each node computes
# with one thread; a job takes about a second.
set -euo pipefail
cd "$(dirname "$0")/.."
jobs=${1:-40}
points=${2:-35000}
bases=${3:-60}
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
        curl -sf -T "$folder/$seed.npy" "$address/clouds?bases=$bases&operator=voronoi" > "$folder/$seed.json"
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

# Of all jobs of the service at $address: p50 and p99 from submission to start, and starts in a second.
figures() {
    python3 - "$address" << 'END'
import json, sys, urllib.request
from datetime import datetime

jobs, query = [], ""
while query is not None:
    page = json.load(urllib.request.urlopen(f"{sys.argv[1]}/jobs?limit=100{query}"))
    jobs += page["jobs"]
    query = page["next"] and "&cursor=" + page["next"]
seconds = lambda job, name: datetime.fromisoformat(job[name].replace("Z", "+00:00")).timestamp()
waits = sorted(seconds(job, "started") - seconds(job, "created") for job in jobs)
starts = [seconds(job, "started") for job in jobs]
quantile = lambda q: 1000 * waits[min(len(waits) - 1, int(q * len(waits)))]
rate = (len(starts) - 1) / (max(starts) - min(starts))
print(f"{len(jobs)} jobs: p50 {quantile(0.5):.0f} ms, p99 {quantile(0.99):.0f} ms from submission to start; {rate:.0f} starts/s")
END
}

"$chladni" sample sphere --points 60 -o "$folder/tiny.npy" > /dev/null
# A tolerance of its own makes each a job of its own.
submit_tiny() { curl -sf -T "$folder/tiny.npy" "$address/clouds?bases=2&operator=voronoi&tolerance=1.$(printf %05d "$1")e-3"; }

measure() { # name, database
    start "$1" "$2"
    echo "$1, idle, one job at a time:"
    for job in $(seq 200); do
        id=$(submit_tiny "$job" | grep -o '"id":"[^"]*"' | tail -n 1 | cut -d '"' -f 4)
        curl -sf "$address/jobs/$id?wait=60" > /dev/null
    done
    figures
    stop
}
measure SQLite "$folder/idle.db"
sql -c 'CREATE DATABASE idle'
measure PostgreSQL "postgresql:///idle?host=$folder/pg&user=postgres"

drain() { # name, database: how fast one node empties a queue of 1,000, which a long job holds up until they all wait
    start "$1-drain" "$2" --queue-max 2000 --queue-max-per-key 2000 --workers 1
    long=$(curl -sf -T "$folder/long.npy" "$address/clouds?bases=500&operator=voronoi" |
        grep -o '"id":"[^"]*"' | tail -n 1 | cut -d '"' -f 4)
    for job in $(seq 1000); do submit_tiny "$job" > /dev/null; done
    curl -sf -X POST "$address/jobs/$long/cancel" > /dev/null
    until curl -sf "$address/jobs?state=queued&limit=1" | grep -q '"jobs":\[\]'; do sleep 0.2; done
    sleep 1
    curl -sf -X DELETE "$address/jobs/$long"
    echo "$1, 1,000 jobs waiting:"
    figures
    stop
}
"$chladni" sample sphere --points 400000 -o "$folder/long.npy" > /dev/null
drain SQLite "$folder/drain.db"
sql -c 'CREATE DATABASE drain'
drain PostgreSQL "postgresql:///drain?host=$folder/pg&user=postgres"
