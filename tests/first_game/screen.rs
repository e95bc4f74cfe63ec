//! Virtual screen, and programs that run on it.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// X server without a monitor. Dropping the value stops the server.
struct Screen {
    server: Child,
    display: String,
}

impl Screen {
    /// Starts a server on a free display.
    fn start() -> Self {
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1280x720x24"])
            .args(["-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap_or_else(|error| panic!("Xvfb (scripts/setup.sh test installs it): {error}"));
        let stdout = server.stdout.take().expect("standard output is piped");
        let mut display = String::new();
        BufReader::new(stdout)
            .read_line(&mut display)
            .expect("Xvfb writes its display");
        let display = format!(":{}", display.trim());
        Self { server, display }
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// Runs an executable with one argument to its end and returns its output. Bevy reads assets from
/// `asset_root`, or from the folder of the executable.
pub fn run(program: &Path, argument: &str, asset_root: Option<&Path>, out: &Path) -> String {
    let screen = Screen::start();
    let mut command = Command::new(program);
    command
        .arg(argument)
        .env("DISPLAY", &screen.display)
        .env("MGI_FIRST_GAME", out)
        .env("NO_COLOR", "1")
        .env_remove("CARGO_MANIFEST_DIR")
        .env_remove("BEVY_ASSET_ROOT")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("RUST_LOG");
    if let Some(root) = asset_root {
        command.env("BEVY_ASSET_ROOT", root);
    }
    let output = command.output().expect("the program starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}:\n{text}", program.display());
    text
}
