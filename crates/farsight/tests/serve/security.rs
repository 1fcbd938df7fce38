//! Who may ask, over what, and what is written down.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::{Arc, Mutex};

use farsight::service::{Config, Log, Tls, Token};
use serde_json::Value;
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};

use crate::client::{Response, Stage, get, post, sent};

/// Asks for a path under another name.
fn as_host(stage: &Stage, host: &str) -> Response {
    let mut stream = TcpStream::connect(stage.server.address()).unwrap();
    write!(stream, "GET /v1/cameras HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").unwrap();
    crate::client::received(stream)
}

#[test]
fn requests_for_other_hosts_are_refused_unless_a_token_protects() {
    let stage = Stage::new(Config { hosts: vec!["camera.example".to_owned()], ..Config::default() });
    for (host, status) in [
        ("localhost:8080", 200),
        ("127.0.0.1", 200),
        ("[::1]:8080", 200),
        ("camera.example", 200),
        ("rebound.example", 421),
        ("localhost.rebound.example", 421),
        ("", 421),
    ] {
        assert_eq!(as_host(&stage, host).status, status, "{host}");
    }
    assert_eq!(as_host(&stage, "rebound.example").error().0, "wrong_host");
    let token = Some(Token::new("0123456789abcdef").unwrap());
    let with_token = Stage::new(Config { token, ..Config::default() });
    assert_eq!(as_host(&with_token, "any.example").status, 401);
}

#[test]
fn every_request_has_an_identity_that_is_in_the_log_with_its_outcome() {
    let lines = Arc::new(Mutex::new(Vec::<Value>::new()));
    let kept = Arc::clone(&lines);
    let log = Log::new(move |record| kept.lock().unwrap().push(serde_json::to_value(record).unwrap()));
    let stage = Stage::new(Config { log, ..Config::default() });
    let address = stage.server.address();
    let given = sent(address, "GET /v1/cameras", &["X-Request-Id: from-the-proxy"], b"");
    assert!(given.head.contains("x-request-id: from-the-proxy\r\n"), "{}", given.head);
    let odd = format!("X-Request-Id: {}", "x".repeat(1000));
    let made = [&odd[..], "X-Request-Id: a b", "X-Other: none"].map(|header| {
        let head = sent(address, "POST /v1/range?hfov=65&name=secret", &[header, "Content-Length: 0"], b"").head;
        head.split("x-request-id: ").nth(1).unwrap().split("\r\n").next().unwrap().to_owned()
    });
    assert!(made.iter().all(|id| id.len() < 60 && !id.contains('x')), "{made:?}");
    assert!(made[0] != made[1] && made[1] != made[2], "{made:?}");
    assert_eq!(post(address, "?hfov=65", b"panic").status, 500);
    assert_eq!(get(address, "/v1/none/secret").status, 404);
    let lines = lines.lock().unwrap();
    let told = |field: &str| lines.iter().map(|line| line[field].clone()).collect::<Vec<_>>();
    assert_eq!(told("id")[..4], ["from-the-proxy", &made[0], &made[1], &made[2]]);
    assert_eq!(told("route"), ["/v1/cameras", "/v1/range", "/v1/range", "/v1/range", "/v1/range", ""]);
    assert_eq!(told("reason"), ["ok", "bad_request", "bad_request", "bad_request", "panic", "not_found"]);
    assert_eq!(told("status"), [200, 400, 400, 400, 500, 404]);
    assert!(lines.iter().all(|line| line["time_s"].as_f64() > Some(1.7e9) && line["took_ms"].as_f64() >= Some(0.0)));
    assert!(!lines.iter().any(|line| line.to_string().contains("secret")), "{lines:?}");
}

#[test]
fn metrics_tell_outcomes_queue_and_stages() {
    let stage = Stage::new(Config::default());
    let address = stage.server.address();
    assert_eq!(post(address, "?hfov=65", b"an image").status, 200);
    assert_eq!(post(address, "?hfov=wide", b"an image").status, 400);
    let metrics = get(address, "/metrics");
    assert!(metrics.head.contains("content-type: application/openmetrics-text; version=1.0.0"), "{}", metrics.head);
    for line in [
        "farsight_requests_total{route=\"/v1/range\",status=\"200\",reason=\"ok\"} 1",
        "farsight_requests_total{route=\"/v1/range\",status=\"400\",reason=\"bad_request\"} 1",
        "farsight_request_seconds_count{route=\"/v1/range\"} 2",
        "farsight_requests_waiting 0",
        "farsight_wait_seconds_count 1",
        "farsight_work_seconds_count 1",
        "farsight_stage_seconds_count{stage=\"network\"} 1",
        "# EOF",
    ] {
        assert!(metrics.body.lines().any(|known| known == line), "no {line} in {}", metrics.body);
    }
    let waiting = stage.waiting();
    let second = std::thread::spawn(move || post(address, "?hfov=65", b"an image"));
    stage.until_inside(2);
    assert!(get(address, "/metrics").body.contains("farsight_requests_waiting 1\n"));
    stage.go_on.send(()).unwrap();
    assert_eq!([waiting.join().unwrap().status, second.join().unwrap().status], [200, 200]);
}

#[test]
fn it_speaks_tls_and_nothing_else_where_it_has_a_certificate() {
    let pair = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
    let (certificate, key) = (pair.cert.pem(), pair.signing_key.serialize_pem());
    let tls = Tls::from_pem(certificate.as_bytes(), key.as_bytes()).unwrap();
    let stage = Stage::new(Config { tls: Some(tls), ..Config::default() });
    let mut roots = RootCertStore::empty();
    roots.add(pair.cert.der().clone()).unwrap();
    let config = ClientConfig::builder_with_provider(Arc::new(default_provider()));
    let config = config.with_safe_default_protocol_versions().unwrap().with_root_certificates(roots);
    let config = Arc::new(config.with_no_client_auth());
    let client = ClientConnection::new(config, "localhost".try_into().unwrap()).unwrap();
    let mut stream = StreamOwned::new(client, TcpStream::connect(stage.server.address()).unwrap());
    stream.write_all(b"GET /v1/cameras HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    // Servers of HTTP end without the farewell of TLS.
    let _ = stream.read_to_string(&mut answer);
    assert!(answer.starts_with("HTTP/1.1 200 OK") && answer.ends_with(r#"{"cameras":[],"videos":[]}"#), "{answer}");
    let mut plain = TcpStream::connect(stage.server.address()).unwrap();
    plain.write_all(b"GET /v1/cameras HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    let mut answer = Vec::new();
    let _ = plain.read_to_end(&mut answer);
    assert!(!answer.starts_with(b"HTTP"), "{answer:?}");

    let other = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap().signing_key.serialize_pem();
    for (certificate, key, told) in [
        ("", &key[..], "the certificate cannot be read"),
        (&certificate, "", "the key cannot be read"),
        (&certificate, &other, "certificate and key cannot be used"),
    ] {
        let error = Tls::from_pem(certificate.as_bytes(), key.as_bytes()).unwrap_err().to_string();
        assert!(error.contains(told), "{error}");
    }
}

#[test]
fn pages_of_other_origins_may_not_read_answers() {
    let stage = Stage::new(Config::default());
    let address = stage.server.address();
    let origin = "Origin: https://elsewhere.example";
    let image = ["Content-Length: 8", origin];
    let asks = ["Access-Control-Request-Method: POST", "Access-Control-Request-Headers: authorization", origin];
    for (answer, status) in [
        (sent(address, "POST /v1/range?hfov=65", &image, b"an image"), 200),
        (sent(address, "OPTIONS /v1/range?hfov=65", &asks, b""), 405),
        (sent(address, "POST /v1/range?hfov=wide", &image, b"an image"), 400),
        (sent(address, "OPTIONS /v2/models/stand-in/infer", &asks, b""), 405),
        (sent(address, "GET /v1/cameras", &[origin], b""), 200),
    ] {
        assert_eq!(answer.status, status, "{answer:?}");
        assert!(!answer.head.contains("access-control-"), "{}", answer.head);
    }
}

#[test]
fn the_page_needs_nothing_from_elsewhere() {
    let stage = Stage::new(Config::default());
    let scripts =
        ["/page.js", "/geometry.js", "/drawing.js", "/film.js", "/corners.js"].map(|path| (path, "text/javascript"));
    for (path, kind) in [("/", "text/html"), ("/page.css", "text/css")].into_iter().chain(scripts) {
        let page = get(stage.server.address(), path);
        assert_eq!(page.status, 200);
        assert!(page.head.contains(&format!("content-type: {kind}; charset=utf-8")), "{}", page.head);
        assert!(page.head.contains("content-security-policy: default-src 'none'"), "{}", page.head);
        assert!(!page.head.contains("access-control-allow-origin"), "{}", page.head);
        assert!(!page.body.contains("//") || kind == "text/javascript", "{path} names another place");
        assert!(!page.body.contains("http:") && !page.body.contains("https:"), "{path} names another place");
    }
}
