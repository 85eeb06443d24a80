//! Files that appear whole or not at all: written beside their place under another name, then renamed.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};

/// Whether `path` can be written, to be asked before long work: its folder must take a file, and what stands there now,
/// if anything, must be an ordinary file. Leaves nothing behind.
pub fn check(path: &Path) -> Result<()> {
    let staged = Staged::create(path)?;
    drop(staged);
    Ok(())
}

/// Writes all `files` or none: nothing takes its place before everything is on the disk.
pub fn write(files: &[(&Path, &[u8])]) -> Result<()> {
    let mut staged = Vec::new();
    for (path, bytes) in files {
        let mut file = Staged::create(path)?;
        file.fill(bytes)
            .with_context(|| format!("cannot write {}", path.display()))?;
        staged.push(file);
    }
    for file in staged {
        file.publish()?;
    }
    Ok(())
}

/// Writes a file that nobody but its owner can read.
pub fn write_secret(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = Staged::create(path)?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        file.file.set_permissions(fs::Permissions::from_mode(0o600))?;
    }
    file.fill(bytes)
        .with_context(|| format!("cannot write {}", path.display()))?;
    file.publish()
}

/// A file under its temporary name; removed when dropped.
struct Staged {
    file: File,
    temporary: PathBuf,
    place: PathBuf,
}

impl Staged {
    fn create(path: &Path) -> Result<Self> {
        // A link stays a link: its target is what is replaced.
        let place = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
        if fs::metadata(&place).is_ok_and(|present| !present.is_file()) {
            bail!(
                "cannot write {}: something that is not a file stands there",
                path.display()
            );
        }
        let name = place
            .file_name()
            .ok_or_else(|| anyhow!("cannot write {}: it names no file", path.display()))?;
        let mut hidden = OsString::from(".");
        hidden.push(name);
        hidden.push(format!(".{}.part", std::process::id()));
        let temporary = place.with_file_name(hidden);
        let file = File::create(&temporary).map_err(|error| match error.kind() {
            ErrorKind::NotFound | ErrorKind::NotADirectory => anyhow!(
                "cannot write {}: its folder does not exist; create it first",
                path.display()
            ),
            _ => anyhow!("cannot write {}: {error}", path.display()),
        })?;
        Ok(Self { file, temporary, place })
    }

    fn fill(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.file.write_all(bytes)?;
        self.file.sync_all()
    }

    fn publish(self) -> Result<()> {
        fs::rename(&self.temporary, &self.place).with_context(|| format!("cannot write {}", self.place.display()))
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        // After a rename there is nothing left under this name, and that is fine.
        let _ = fs::remove_file(&self.temporary);
    }
}
