//! The page in a real browser: Chromium, driven by playwright-core.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use farsight::service::{Config, Infer, SourceFrames, Token, Video, VideoFailure};
use farsight::{CameraSource, Pipeline};

use crate::program::root;
use crate::videos::{frame, served};

/// Pinned, so that a newer one breaks nothing.
const PLAYWRIGHT: &str = "playwright-core@1.65.1";

/// What one of the services asks for.
const TOKEN: &str = "0123456789abcdef";

/// A film of one scene, in which a car comes nearer.
#[derive(Debug)]
struct Scene {
    image: PathBuf,
}

impl Video for Scene {
    fn open(&self) -> Result<SourceFrames, VideoFailure> {
        let image = farsight::read_image(&self.image)?;
        Ok(Box::new((0..30).map(move |number| Ok(frame(number, number as f64 * 0.1, image.clone(), 81.4)))))
    }
}

/// A film that is not there.
#[derive(Debug)]
struct Missing;

impl Video for Missing {
    fn open(&self) -> Result<SourceFrames, VideoFailure> {
        Err("no such film".into())
    }
}

fn works(command: &mut Command) -> bool {
    command.output().is_ok_and(|output| output.status.success())
}

/// A browser, and the folder with what drives it; or why there is none.
fn tools() -> Result<(PathBuf, PathBuf), &'static str> {
    let named = std::env::var_os("FARSIGHT_CHROMIUM").map(PathBuf::from);
    let usual = ["/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"].map(PathBuf::from);
    let browser = named.into_iter().chain(usual).find(|path| path.is_file()).ok_or("there is no Chromium")?;
    if !works(Command::new("node").arg("--version")) {
        return Err("there is no node");
    }
    let folder = root().join("target/page-test");
    if !folder.join("node_modules/playwright-core").is_dir() {
        std::fs::create_dir_all(&folder).unwrap();
        let mut install = Command::new("npm");
        install.args(["install", "--no-audit", "--no-fund", "--no-save", PLAYWRIGHT]).current_dir(&folder);
        if !works(&mut install) {
            return Err("npm fetches no playwright-core");
        }
    }
    Ok((browser, folder))
}

#[test]
fn the_page_works_in_a_browser() {
    let (browser, folder) = match tools() {
        Ok(tools) => tools,
        Err(why) => return eprintln!("skipped: {why}, so the page was not tried in a browser"),
    };
    let image = root().join("assets/scenes/image_2/000000.jpg");
    let infer: Arc<dyn Infer> = Arc::new(Pipeline::shipped().unwrap());
    let front: Arc<dyn Video> = Arc::new(Scene { image: image.clone() });
    let cameras = BTreeMap::from([("dash".to_owned(), CameraSource::FieldOfView(81.4).into())]);
    let videos = vec![("front", Arc::clone(&front)), ("broken", Arc::new(Missing))];
    // A machine that has other work takes longer than usual.
    let deadline = Duration::from_mins(5);
    let server = served(&infer, videos, Config { cameras, deadline, ..Config::default() });
    let token = Some(Token::new(TOKEN).unwrap());
    let guarded = served(&infer, vec![("front", front)], Config { token, deadline, ..Config::default() });
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/serve/page.mjs");
    // Beside its library, where node looks for it.
    std::fs::copy(&script, folder.join("page.mjs")).unwrap();
    let mut command = Command::new("node");
    let [open, guarded] = [&server, &guarded].map(|server| format!("http://{}", server.address()));
    command.arg("page.mjs").args([open, guarded, TOKEN.to_owned()]).arg(browser).arg(image);
    let output = command.current_dir(&folder).output().unwrap();
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{told}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(told.contains("all of the page works"), "{told}");
}
