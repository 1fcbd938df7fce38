//! What every request goes through: its identity, its place in metrics and log, and who may ask.

use std::net::IpAddr;
use std::panic::AssertUnwindSafe;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use axum::body::{Body, to_bytes};
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures_util::FutureExt;

use super::log::{LogRecord, now_s};
use super::rejection::{Reason, Rejection};
use super::shared::{Service, Shared};
use super::{MAX_BODY_BYTES, PAUSE};

/// Of a request, and of its response.
const REQUEST_ID: HeaderName = HeaderName::from_static("x-request-id");

/// Longer identities are somebody's attempt to fill a log.
const MAX_ID: usize = 128;

/// The page may load and ask this service, and nothing else.
const CONTENT_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                              connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Answers, counts and writes down.
pub(super) async fn observed(State(shared): Service, request: Request, next: Next) -> Response {
    let begun = Instant::now();
    let id = request_id(request.headers());
    let method = request.method().clone();
    let route = request.extensions().get::<MatchedPath>().map_or_else(String::new, |path| path.as_str().to_owned());
    let mut response = match check_host(&shared, &request) {
        Ok(()) => {
            let answer = AssertUnwindSafe(next.run(request)).catch_unwind().await;
            answer.unwrap_or_else(|_| Rejection::panicked().into_response())
        }
        Err(rejection) => refused(request.into_body(), rejection),
    };
    let status = response.status().as_u16();
    let reason = response.extensions().get::<Reason>().map_or("ok", |Reason(reason)| reason);
    shared.metrics.answered(&route, status, reason, begun.elapsed());
    let took_ms = begun.elapsed().as_secs_f64() * 1e3;
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, CONTENT_POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if let Ok(id) = HeaderValue::from_str(&id) {
        headers.insert(REQUEST_ID, id);
    }
    let method = method.to_string();
    shared.config.log.tell(&LogRecord::Request { time_s: now_s(), id, method, route, status, reason, took_ms });
    response
}

/// The identity that a request brings, if it is one, or a new one.
fn request_id(headers: &HeaderMap) -> String {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let given = headers.get(REQUEST_ID).and_then(|id| id.to_str().ok());
    let given = given.filter(|id| (1..=MAX_ID).contains(&id.len()) && id.bytes().all(|byte| byte.is_ascii_graphic()));
    given.map_or_else(
        || {
            // Unlike those of other processes of this machine, and of this one before it was started anew.
            let [process, time, number] =
                [u64::from(std::process::id()), (now_s() * 1e3) as u64, NEXT.fetch_add(1, Ordering::Relaxed)];
            format!("{time:x}-{process:x}-{number:x}")
        },
        str::to_owned,
    )
}

/// Refuses what was sent to another name. A page of a stranger can point its own name at this machine (DNS rebinding)
/// and would be taken for the service's own; with a token it knows too little.
fn check_host(shared: &Shared, request: &Request) -> Result<(), Rejection> {
    if shared.config.token.is_some() {
        return Ok(());
    }
    let authority = request.uri().authority().map(axum::http::uri::Authority::as_str);
    let host = authority.or_else(|| request.headers().get(header::HOST)?.to_str().ok());
    if host.is_some_and(|host| is_own(host, &shared.config.hosts)) {
        return Ok(());
    }
    let message =
        "the request is for another host; expected an address, localhost, or a name that the service was told of";
    Err(Rejection::new(StatusCode::MISDIRECTED_REQUEST, "wrong_host", message))
}

/// Whether a host (with or without a port) is an address, this machine's own name for itself, or one of `names`.
fn is_own(host: &str, names: &[String]) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.rsplit_once(':').map_or(host, |(name, _)| name),
    };
    let name = name.trim_end_matches('.').to_ascii_lowercase();
    let is_named = names.iter().any(|own| own.eq_ignore_ascii_case(&name));
    is_named || name == "localhost" || name.ends_with(".localhost") || name.parse::<IpAddr>().is_ok()
}

/// Lets those pass who bring the token, if there is one.
pub(super) async fn check_token(State(shared): Service, request: Request, next: Next) -> Response {
    let Some(token) = &shared.config.token else { return next.run(request).await };
    let given = request.headers().get(header::AUTHORIZATION).map(HeaderValue::as_bytes);
    if given.and_then(|given| given.strip_prefix(b"Bearer ")).is_some_and(|given| token.is(given)) {
        return next.run(request).await;
    }
    let message = "no token, or another one; expected the header Authorization: Bearer TOKEN";
    refused(request.into_body(), Rejection::new(StatusCode::UNAUTHORIZED, "unauthorized", message))
}

fn refused(body: Body, rejection: Rejection) -> Response {
    drain(body);
    rejection.into_response()
}

/// Reads what a refused client still sends, in moderation: one that is cut off while it sends sees no answer.
pub(super) fn drain(body: Body) {
    tokio::spawn(async move {
        let reading = to_bytes(body, MAX_BODY_BYTES);
        // What comes of it does not matter.
        let _ = tokio::time::timeout(PAUSE * 20, reading).await;
    });
}

#[cfg(test)]
mod tests {
    use super::is_own;

    #[test]
    fn addresses_localhost_and_named_hosts_are_own() {
        let names = ["camera.example".to_owned()];
        for own in
            ["127.0.0.1:8080", "127.0.0.1", "[::1]:8080", "localhost:8080", "LOCALHOST.", "a.localhost", "10.1.2.3:1"]
        {
            assert!(is_own(own, &names), "{own}");
        }
        assert!(is_own("Camera.Example:443", &names));
        for other in
            ["", "evil.example:8080", "localhost.evil.example", "127.0.0.1.evil.example", "camera.example.evil"]
        {
            assert!(!is_own(other, &names), "{other}");
        }
    }
}
