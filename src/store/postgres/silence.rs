//! A server from which nothing comes any more.
//!
//! A network that drops packets without a word leaves connections on which neither an answer nor an error ever arrives; the
//! kernel gives them up after a quarter of an hour. So no statement is waited for longer than [`PATIENCE`], and a node whose
//! signs of life are not taken makes its connections anew.

use std::time::Duration;

use futures_util::stream::{self, Stream, StreamExt};
use sqlx::Error;

/// Longer than any statement takes: the longest delete a result of many gigabytes.
const PATIENCE: Duration = Duration::from_mins(5);

/// The answer, or the error of a connection that timed out.
pub(in crate::store) fn answer<T, E: From<Error>>(
    asked: impl Future<Output = Result<T, E>>,
) -> impl Future<Output = Result<T, E>> {
    // On the heap: statements lie in the midst of whole requests.
    within(PATIENCE, Box::pin(asked))
}

/// The same for each of many rows.
pub(in crate::store) fn answers<T>(
    rows: impl Stream<Item = Result<T, Error>> + Unpin,
) -> impl Stream<Item = Result<T, Error>> {
    each_within(PATIENCE, rows)
}

async fn within<T, E: From<Error>>(
    patience: Duration,
    asked: impl Future<Output = Result<T, E>>,
) -> Result<T, E> {
    tokio::time::timeout(patience, asked).await.unwrap_or_else(|_| Err(silent(patience).into()))
}

fn each_within<T>(
    patience: Duration,
    rows: impl Stream<Item = Result<T, Error>> + Unpin,
) -> impl Stream<Item = Result<T, Error>> {
    stream::unfold(Some(rows), move |rows| async move {
        let mut rows = rows?;
        match tokio::time::timeout(patience, rows.next()).await {
            Ok(row) => Some((row?, Some(rows))),
            Err(_) => Some((Err(silent(patience)), None)),
        }
    })
    .fuse()
}

fn silent(patience: Duration) -> Error {
    let seconds = patience.as_secs();
    Error::Io(std::io::Error::new(
        std::io::ErrorKind::TimedOut,
        format!("the server did not answer in {seconds} seconds"),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_server_that_says_nothing_is_given_up() {
        const SHORT: Duration = Duration::from_millis(10);
        let silent = within(SHORT, std::future::pending::<Result<(), Error>>()).await;
        assert!(matches!(silent, Err(Error::Io(_))), "{silent:?}");
        assert!(matches!(answer(async { Ok::<_, Error>(1) }).await, Ok(1)));
        let rows = stream::iter([Ok(1), Ok(2)]).chain(stream::pending());
        let read: Vec<_> = each_within(SHORT, rows.boxed()).collect().await;
        assert!(matches!(read[..], [Ok(1), Ok(2), Err(Error::Io(_))]), "{read:?}");
    }
}
