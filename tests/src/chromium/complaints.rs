//! What a page's events say against it.

use std::collections::BTreeMap;

use serde_json::Value;

/// Schemes that need no network.
const LOCAL: [&str; 3] = ["file:", "data:", "about:"];

/// The complaints of one page, in the order in which they came.
pub(super) fn all(events: &[Value], session: &str) -> Vec<String> {
    let mut urls = BTreeMap::new();
    let mut all = Vec::new();
    for (method, event) in of_session(events, session) {
        match method {
            "Runtime.consoleAPICalled" => {
                let kind = text(&event["type"]);
                if matches!(kind, "error" | "warning" | "assert") {
                    all.push(format!("console {kind}: {}", arguments(&event["args"])));
                }
            }
            "Runtime.exceptionThrown" => all.push(exception(&event["exceptionDetails"])),
            "Log.entryAdded" => {
                let entry = &event["entry"];
                let (level, url) = (text(&entry["level"]), text(&entry["url"]));
                if matches!(level, "error" | "warning") {
                    all.push(format!("browser {level}: {} {url}", text(&entry["text"])));
                }
            }
            "Network.requestWillBeSent" => {
                let url = text(&event["request"]["url"]);
                urls.insert(text(&event["requestId"]), url);
                all.extend(foreign(url));
            }
            // Requests of another page, or none that are called so.
            "Network.webSocketCreated" | "Page.windowOpen" => {
                all.extend(foreign(text(&event["url"])))
            }
            "Network.loadingFailed" => {
                let url = urls.get(text(&event["requestId"])).unwrap_or(&"");
                all.push(format!("request failed: {url}: {}", text(&event["errorText"])));
            }
            _ => {}
        }
    }
    all
}

/// The addresses of requests that are under way.
pub(super) fn unfinished(events: &[Value], session: &str) -> Vec<String> {
    let mut urls = BTreeMap::new();
    for (method, event) in of_session(events, session) {
        let request = text(&event["requestId"]);
        match method {
            "Network.requestWillBeSent" => {
                urls.insert(request, text(&event["request"]["url"]));
            }
            "Network.loadingFinished" | "Network.loadingFailed" => {
                urls.remove(request);
            }
            _ => {}
        }
    }
    urls.into_values().map(str::to_owned).collect()
}

/// An exception's text with its place.
pub(super) fn exception(details: &Value) -> String {
    let thrown = &details["exception"];
    let thrown =
        thrown["description"].as_str().map_or_else(|| thrown["value"].to_string(), str::to_owned);
    let line = details["lineNumber"].as_u64().map_or(0, |line| line + 1);
    format!("{}: {thrown} at {}:{line}", text(&details["text"]), text(&details["url"]))
}

fn of_session<'a>(
    events: &'a [Value],
    session: &'a str,
) -> impl Iterator<Item = (&'a str, &'a Value)> {
    let own = events.iter().filter(move |event| event["sessionId"] == session);
    own.map(|event| (text(&event["method"]), &event["params"]))
}

fn foreign(url: &str) -> Option<String> {
    let local = LOCAL.iter().any(|scheme| url.starts_with(scheme));
    (!local).then(|| format!("request beyond the page's files: {url}"))
}

/// What was passed to a method of the console, as it would print it.
fn arguments(values: &Value) -> String {
    let print = |value: &Value| match (&value["value"], &value["description"]) {
        (Value::String(text), _) | (Value::Null, Value::String(text)) => text.clone(),
        (plain, _) => plain.to_string(),
    };
    values.as_array().into_iter().flatten().map(print).collect::<Vec<_>>().join(" ")
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}
