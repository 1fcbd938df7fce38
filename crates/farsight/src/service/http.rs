//! The paths of the service.

use std::sync::Arc;

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodRouter, get, post};
use axum::{Json, Router};
use serde_json::json;

use super::rejection::Rejection;
use super::shared::{Service, Shared};
use super::{calibrate, guard, inference, range, streams};

/// A path, what it answers to, and whether it asks for the token.
struct Route {
    #[cfg_attr(not(test), expect(dead_code, reason = "read by the test of the description"))]
    method: &'static str,
    path: &'static str,
    needs_token: bool,
    answer: MethodRouter<Arc<Shared>>,
}

/// What the page is made of: path, kind, text.
const PAGE: [(&str, &str, &str); 7] = [
    ("/", "text/html", include_str!("page/index.html")),
    ("/page.css", "text/css", include_str!("page/page.css")),
    ("/page.js", "text/javascript", include_str!("page/page.js")),
    ("/geometry.js", "text/javascript", include_str!("page/geometry.js")),
    ("/drawing.js", "text/javascript", include_str!("page/drawing.js")),
    ("/film.js", "text/javascript", include_str!("page/film.js")),
    ("/corners.js", "text/javascript", include_str!("page/corners.js")),
];

/// The description of all paths (`OpenAPI` 3.1).
const DESCRIPTION: &str = include_str!("openapi.json");

/// All paths.
fn routes() -> Vec<Route> {
    let open = |path, answer| Route { method: "get", path, needs_token: false, answer };
    let page = |(path, kind, text): (&'static str, &'static str, &'static str)| {
        open(path, get(move || async move { ([(header::CONTENT_TYPE, format!("{kind}; charset=utf-8"))], text) }))
    };
    let reads = |path, answer| Route { method: "get", path, needs_token: true, answer };
    let asks = |path, answer| Route { method: "post", path, needs_token: true, answer };
    let description = || async { ([(header::CONTENT_TYPE, "application/json")], DESCRIPTION) };
    let mut routes: Vec<Route> = PAGE.into_iter().map(page).collect();
    routes.extend([
        open("/openapi.json", get(description)),
        open("/v2", get(inference::server)),
        open("/v2/health/live", get(inference::live)),
        open("/v2/health/ready", get(inference::ready)),
        reads("/v2/models/{model}", get(inference::model)),
        reads("/v2/models/{model}/ready", get(inference::model_ready)),
        asks("/v2/models/{model}/infer", post(inference::infer)),
        asks("/v1/range", post(range::range)),
        asks("/v1/calibrate", post(calibrate::calibrate)),
        reads("/v1/cameras", get(cameras)),
        reads("/v1/videos/{video}/tracks", get(streams::tracks)),
        reads("/v1/videos/{video}/frames", get(streams::frames)),
        reads("/metrics", get(metrics)),
    ]);
    routes
}

/// The paths of the service.
pub(super) fn router(shared: Arc<Shared>) -> Router {
    let check_token = from_fn_with_state(Arc::clone(&shared), guard::check_token);
    let observed = from_fn_with_state(Arc::clone(&shared), guard::observed);
    let add = |router: Router<Arc<Shared>>, Route { path, needs_token, answer, .. }: Route| {
        router.route(path, if needs_token { answer.layer(check_token.clone()) } else { answer })
    };
    routes()
        .into_iter()
        .fold(Router::new(), add)
        .fallback(|| async { Rejection::not_found("not_found", "no such path; /openapi.json has them") })
        .method_not_allowed_fallback(|| async {
            let message = "the path does not answer to this method; /openapi.json says to which";
            Rejection::new(StatusCode::METHOD_NOT_ALLOWED, "method", message)
        })
        .layer(observed)
        .with_state(shared)
}

async fn metrics(State(shared): Service) -> Response {
    let kind = [(header::CONTENT_TYPE, "application/openmetrics-text; version=1.0.0; charset=utf-8")];
    let queue = &shared.queue;
    (kind, shared.metrics.text(queue.inside(), queue.waiting())).into_response()
}

async fn cameras(State(shared): Service) -> Response {
    let cameras: Vec<&String> = shared.config.cameras.keys().collect();
    let videos: Vec<&String> = shared.videos.names().collect();
    Json(json!({"cameras": cameras, "videos": videos})).into_response()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use serde_json::Value;

    use super::{DESCRIPTION, routes};

    /// Methods and paths of the description, and those of them that say that they need the token.
    fn described() -> [BTreeSet<(String, String)>; 2] {
        let text: Value = serde_json::from_str(DESCRIPTION).unwrap();
        let (mut all, mut guarded) = (BTreeSet::new(), BTreeSet::new());
        for (path, methods) in text["paths"].as_object().unwrap() {
            for (method, operation) in methods.as_object().unwrap() {
                all.insert((method.clone(), path.clone()));
                if operation.get("security").is_some() {
                    guarded.insert((method.clone(), path.clone()));
                }
            }
        }
        [all, guarded]
    }

    #[test]
    fn the_description_has_every_path_and_no_other() {
        let name = |route: &super::Route| (route.method.to_owned(), route.path.to_owned());
        let all: BTreeSet<_> = routes().iter().map(name).collect();
        let guarded: BTreeSet<_> = routes().iter().filter(|route| route.needs_token).map(name).collect();
        assert_eq!(described(), [all, guarded]);
    }

    #[test]
    fn everything_that_the_description_refers_to_is_in_it() {
        fn references(value: &Value, found: &mut Vec<String>) {
            match value {
                Value::Object(fields) => {
                    found.extend(fields.get("$ref").map(|to| to.as_str().unwrap().to_owned()));
                    fields.values().for_each(|value| references(value, found));
                }
                Value::Array(values) => values.iter().for_each(|value| references(value, found)),
                _ => {}
            }
        }
        let text: Value = serde_json::from_str(DESCRIPTION).unwrap();
        let mut found = Vec::new();
        references(&text, &mut found);
        assert!(found.len() > 20, "{found:?}");
        for reference in found {
            let pointer = reference.strip_prefix('#').unwrap();
            assert!(text.pointer(pointer).is_some(), "{reference}");
        }
    }
}
