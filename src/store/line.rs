//! The order in which waiting jobs are served: owners take turns, and each owner's jobs go in the order of submission.

use uuid::Uuid;

use super::connection::Connection;
use super::{JobRecord, StoreError};

/// An owner with jobs that wait.
#[derive(Debug, PartialEq)]
struct Waiting {
    owner: String,
    jobs: u64,
    /// Goes up with every job of the owner that is claimed; 0 before the first.
    turn: i64,
    first: Uuid,
}

/// All owners with jobs that wait.
#[derive(Debug)]
pub(super) struct Line(Vec<Waiting>);

impl Line {
    pub(super) async fn read(connection: &mut Connection) -> Result<Self, StoreError> {
        let rows: Vec<(String, i64, i64, Uuid)> = connection.query_either(
            "SELECT j.owner, count(*), coalesce(t.turn, 0), min(j.id) FROM jobs j LEFT JOIN turns t ON t.owner = j.owner \
             WHERE j.state = 'queued' GROUP BY j.owner",
            // There is no smallest UUID before version 18.
            "SELECT j.owner, count(*), coalesce(t.turn, 0), (array_agg(j.id ORDER BY j.id))[1] \
             FROM jobs j LEFT JOIN turns t ON t.owner = j.owner WHERE j.state = 'queued' GROUP BY j.owner, t.turn",
        )
        .fetch_all_as()
        .await?;
        let waiting = |(owner, jobs, turn, first)| Waiting { owner, jobs: jobs as u64, turn, first };
        Ok(Self(rows.into_iter().map(|row: (String, i64, i64, Uuid)| waiting(row)).collect()))
    }

    /// Jobs that are served before one that has `before` of its own owner's jobs before it.
    ///
    /// Every round serves each owner once. Before a job of round r stand, of every owner, its jobs of earlier rounds, and
    /// the one of the same round if the owner's turn comes first.
    fn position(&self, owner: &str, before: u64) -> u64 {
        let Some(own) = self.0.iter().find(|waiting| waiting.owner == owner) else { return before };
        let of_others = self.0.iter().filter(|waiting| waiting.owner != owner).map(|other| {
            let comes_first = (other.turn, other.first) < (own.turn, own.first);
            other.jobs.min(before + u64::from(comes_first))
        });
        before + of_others.sum::<u64>()
    }
}

/// Gives queued jobs, which come with the number of their owner's jobs before them, their place among all jobs.
pub(super) async fn place(connection: &mut Connection, jobs: &mut [JobRecord]) -> Result<(), StoreError> {
    if jobs.iter().all(|job| job.queue_position.is_none()) {
        return Ok(());
    }
    let line = Line::read(connection).await?;
    for job in jobs {
        job.queue_position = job.queue_position.map(|before| line.position(job.owner.name(), before));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The order in which jobs are served, found by serving them.
    fn served(line: &mut [Waiting]) -> Vec<String> {
        let (mut order, mut latest) = (Vec::new(), 1000);
        while let Some(next) = line.iter_mut().filter(|o| o.jobs > 0).min_by_key(|o| (o.turn, o.first)) {
            next.jobs -= 1;
            next.turn = latest + 1;
            latest = next.turn;
            order.push(next.owner.clone());
        }
        order
    }

    #[test]
    fn positions_are_those_in_which_jobs_are_served() {
        let line = || {
            let owners = [("a", 5, 7), ("b", 1, 3), ("c", 2, 0), ("d", 3, 0)];
            let waiting = |(place, (owner, jobs, turn)): (usize, (&str, u64, i64))| Waiting {
                owner: owner.to_owned(),
                jobs,
                turn,
                first: Uuid::from_u128(place as u128),
            };
            owners.into_iter().enumerate().map(waiting).collect::<Vec<_>>()
        };
        let order = served(&mut line());
        assert_eq!(&order[..4], ["c", "d", "b", "a"]);
        let mut seen = std::collections::HashMap::new();
        for (position, owner) in order.iter().enumerate() {
            let before = seen.entry(owner.clone()).or_insert(0);
            assert_eq!(Line(line()).position(owner, *before), position as u64, "{owner} {before}");
            *before += 1;
        }
    }
}
