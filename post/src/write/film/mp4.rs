//! MP4 by ffmpeg, which must be installed: pictures go to its standard input.

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use cd_formats::atomic;
use cd_formats::error::{Fault, Faults};

use crate::write::raster::RgbImage;

/// Name of the program.
const FFMPEG: &str = "ffmpeg";

/// Film that ffmpeg encodes.
pub struct Mp4Film {
    program: Child,
    path: PathBuf,
    /// File that becomes `path` when the film is complete.
    part: PathBuf,
}

impl Mp4Film {
    /// Starts a film of pictures of an even width and height.
    ///
    /// Errors if ffmpeg is not installed.
    pub fn start(path: &Path, [width, height]: [usize; 2], frames_per_second: u32) -> Result<Mp4Film, Faults> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|error| Fault::from_io(folder, "created", &error))?;
        }
        atomic::remove_temporary_file(path)?;
        let part = atomic::temporary_path(path);
        let (size, rate) = (format!("{width}x{height}"), frames_per_second.to_string());
        let program = Command::new(FFMPEG)
            .args(["-hide_banner", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
            .args(["-s", &size, "-r", &rate, "-i", "-", "-an", "-pix_fmt", "yuv420p", "-movflags", "+faststart"])
            .args(["-fflags", "+bitexact", "-flags:v", "+bitexact", "-f", "mp4"])
            .arg(&part)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn();
        match program {
            Ok(program) => Ok(Mp4Film { program, path: path.to_path_buf(), part }),
            Err(error) if error.kind() == ErrorKind::NotFound => {
                let expected =
                    "expected ffmpeg on PATH, or a name that ends in .gif, for which no other program is needed";
                Err(Fault::new("options".as_ref(), None, "--output", "ffmpeg is not installed", expected).into())
            }
            Err(error) => Err(Fault::from_io(Path::new(FFMPEG), "started", &error).into()),
        }
    }

    /// Appends a picture. Errors: the last message of ffmpeg, if it has ended.
    pub fn append(&mut self, image: &RgbImage) -> Result<(), Faults> {
        let sent = self.program.stdin.as_mut().map(|input| input.write_all(&image.pixels.concat()));
        match sent {
            Some(Ok(())) => Ok(()),
            _ => Err(self.ffmpeg_fault()),
        }
    }

    /// Completes the file. Errors: the last message of ffmpeg, if it fails, or a file that cannot be renamed.
    pub fn finish(mut self) -> Result<(), Faults> {
        drop(self.program.stdin.take());
        if !self.program.wait().is_ok_and(|status| status.success()) {
            return Err(self.ffmpeg_fault());
        }
        Ok(fs::rename(&self.part, &self.path).map_err(|error| Fault::from_io(&self.path, "written", &error))?)
    }

    /// Fault with the last message of ffmpeg, after its end.
    fn ffmpeg_fault(&mut self) -> Faults {
        drop(self.program.stdin.take());
        let mut text = String::new();
        if let Some(errors) = &mut self.program.stderr {
            let _ = errors.read_to_string(&mut text);
        }
        let message = text.lines().last().unwrap_or("no message").trim().to_string();
        Fault::new(&self.path, None, FFMPEG, message, "expected a film; or choose a name that ends in .gif").into()
    }
}

impl Drop for Mp4Film {
    /// Ends ffmpeg and removes an incomplete file.
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
        let _ = fs::remove_file(&self.part);
    }
}
