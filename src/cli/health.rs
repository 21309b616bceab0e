//! `chladni health`: one request, for container health checks where no curl is at hand.

use std::time::Duration;

use hyper::Uri;

use super::Failure;
use super::client::{Client, ClientError};

/// Longest wait for the answer.
const TIMEOUT: Duration = Duration::from_secs(3);

/// Ask a running service whether it is alive.
#[derive(Debug, clap::Args)]
pub(crate) struct HealthArgs {
    /// Address of the service
    #[arg(default_value = "http://127.0.0.1:8080/livez")]
    url: String,
}

/// Succeeds if the service answers with a status of 200 to 299.
pub(crate) async fn run(args: HealthArgs) -> Result<(), Failure> {
    let (authority, path) = split(&args.url)?;
    let asked = async {
        let answer = Client::connect(&authority).await?.get(&path).await?;
        Ok::<_, ClientError>(answer)
    };
    let failed = match tokio::time::timeout(TIMEOUT, asked).await {
        Ok(Ok(_)) => return Ok(()),
        Ok(Err(ClientError::Refused { status, .. })) => format!("answers {status}"),
        Ok(Err(error)) => error.to_string(),
        Err(_) => format!("no answer within {} seconds", TIMEOUT.as_secs()),
    };
    Err(Failure::Other(format!("{}: {failed}", args.url)))
}

/// Host with port, and path, of an `http` URL.
fn split(url: &str) -> Result<(String, String), Failure> {
    let refuse = || Failure::Input(format!("`{url}` is not an address; http://HOST:PORT/livez is one"));
    let parsed: Uri = url.parse().map_err(|_| refuse())?;
    let host = parsed.host().filter(|host| !host.is_empty() && parsed.scheme_str() == Some("http"));
    let path = parsed.path_and_query().map(ToString::to_string).filter(|path| path != "/");
    let port = parsed.port_u16().unwrap_or(80);
    Ok((format!("{}:{port}", host.ok_or_else(refuse)?), path.unwrap_or_else(|| "/livez".to_owned())))
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader, Write};
    use std::net::TcpListener;

    use super::*;

    fn ask(url: String) -> Result<(), Failure> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(run(HealthArgs { url }))
    }

    /// Answers one request with these bytes; gives the request's first line. It reads the whole head first: closing
    /// with bytes unread would reset the connection, and the answer might never be seen.
    fn answered(answer: &'static str) -> (Result<(), Failure>, String) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/livez", listener.local_addr().unwrap());
        let server = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let head: Vec<String> = BufReader::new(&stream)
                .lines()
                .map(Result::unwrap)
                .take_while(|line| !line.is_empty())
                .collect();
            stream.write_all(answer.as_bytes()).unwrap();
            head[0].clone()
        });
        let result = ask(url);
        (result, server.join().unwrap())
    }

    #[test]
    fn an_answer_of_success_is_health() {
        let (result, line) = answered("HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n");
        assert!(result.is_ok());
        assert_eq!(line, "GET /livez HTTP/1.1");
    }

    #[test]
    fn any_other_answer_is_a_failure_that_is_named() {
        let unwell = "HTTP/1.1 503 Service Unavailable
Content-Length: 0

";
        let failure = answered(unwell).0.unwrap_err().to_string();
        assert!(failure.ends_with("/livez: answers 503 Service Unavailable"), "{failure}");
        assert!(
            answered(
                "SSH-2.0
"
            )
            .0
            .is_err()
        );
        assert!(answered("").0.is_err());
    }

    #[test]
    fn addresses_are_taken_apart() {
        let parts = |url| split(url).map_err(|_| ());
        assert_eq!(parts("http://a:1/livez"), Ok(("a:1".into(), "/livez".into())));
        assert_eq!(parts("http://a"), Ok(("a:80".into(), "/livez".into())));
        assert_eq!(parts("http://[::1]:8080/readyz"), Ok(("[::1]:8080".into(), "/readyz".into())));
        for url in ["https://a/", "a:1", "http://", "http:// a/", "http://a/\r\nX: 1"] {
            assert_eq!(parts(url), Err(()), "{url}");
        }
    }

    #[test]
    fn a_port_where_nobody_listens_is_a_failure() {
        let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        assert!(ask(format!("http://{address}/livez")).is_err());
    }
}
