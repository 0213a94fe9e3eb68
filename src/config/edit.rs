//! Changes a machine file and nothing else in it: values are set by their full key, comments, order and layout
//! stay. For what is found out about a machine: gains that were tuned, parameters that were identified.
//!
//! ```text
//!   file ──► MachineFile ──► set, note ──► read again as a machine ──► draft beside it ──► in its place
//! ```
//!
//! A note above a section says where its values come from. It has a mark (`# tuned: ...`), and the next note
//! with this mark takes its place.
//! Invariant: a file is replaced whole, by a text that is a sound machine and was checked before, or not at all.

use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use toml_edit::{Decor, DocumentMut, Item, RawString, Table, TableLike, Value};

use super::machine_file;
use super::problem::FileProblems;
use super::sheet_file::Shelf;
use super::{LoadError, Machine, Purpose};

/// Why a machine file was not changed.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// There is no sound machine to begin with.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The text cannot be taken apart.
    #[error("{}: {cause}", path.display())]
    Grammar {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        cause: toml_edit::TomlError,
    },
    /// A key whose last part is inside of a value.
    #[error("{}: {key} cannot be set, {outer} is no section; write it as [{outer}]", path.display())]
    NoSection {
        /// Which file.
        path: PathBuf,
        /// What was to be set.
        key: String,
        /// What is in the way.
        outer: String,
    },
    /// The changed text is no machine.
    #[error("left as it was, with the new values it would be wrong: {0}")]
    Refused(Box<FileProblems>),
    /// Somebody else changed the file.
    #[error("{} was changed meanwhile and is left as it is; begin again", path.display())]
    Overtaken {
        /// Which file.
        path: PathBuf,
    },
    /// The file cannot be written.
    #[error("{} is left as it was: {cause}", path.display())]
    Unwritable {
        /// Which file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
}

/// A machine file that is being changed.
#[derive(Clone, Debug)]
pub struct MachineFile {
    path: PathBuf,
    /// As it was read; `None` for a file that is to be made.
    before: Option<String>,
    document: DocumentMut,
}

impl MachineFile {
    /// Begin with a file, which must be a sound machine.
    pub fn open(path: &Path) -> Result<Self, EditError> {
        let unreadable = |cause| LoadError::Unreadable { path: path.to_owned(), cause };
        // The file itself, not a link to it: the link shall stay.
        let path = fs::canonicalize(path).map_err(unreadable)?;
        let text = fs::read_to_string(&path).map_err(unreadable)?;
        read(&path, &text).map_err(LoadError::from)?;
        let document = parsed(&path, &text)?;
        Ok(Self { path, before: Some(text), document })
    }

    /// Begin a new file with the text of a machine.
    pub fn create(path: &Path, machine: &Machine) -> Result<Self, EditError> {
        Ok(Self { path: path.to_owned(), before: None, document: parsed(path, &machine.text)? })
    }

    /// Set the value of a full key, as `axis.x.friction.sliding-n`. The comment beside it stays; sections that
    /// are not there are made, each behind the others of its parent.
    pub fn set(&mut self, key: &str, value: impl Into<Value>) -> Result<(), EditError> {
        let (section, name) = key.rsplit_once('.').unwrap_or(("", key));
        let mut value = value.into();
        let path = self.path.clone();
        let table = self.section(section).map_err(|outer| EditError::NoSection {
            path,
            key: key.to_owned(),
            outer,
        })?;
        if let Some(Item::Value(old)) = table.get(name) {
            let beside = aligned(old, &value);
            *value.decor_mut() = beside;
        }
        match table.get_mut(name) {
            // In its place: an inserted key would lose the comment above it.
            Some(item) => *item = Item::Value(value),
            None => drop(table.insert(name, Item::Value(value))),
        }
        Ok(())
    }

    /// Say above the header of a section where its values come from: `# MARK: text`, in place of what was last
    /// said there with this mark. Lines of the text stay lines.
    pub fn note(&mut self, section: &str, mark: &str, text: &str) -> Result<(), EditError> {
        let path = self.path.clone();
        let no_section = |outer| EditError::NoSection { path, key: section.to_owned(), outer };
        let Some(header) = self.header(section) else {
            return Err(no_section(section.to_owned()));
        };
        let before = header.prefix().and_then(|prefix| prefix.as_str()).unwrap_or("\n").to_owned();
        header.set_prefix(noted(&before, mark, text));
        Ok(())
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Put the text as it was read into another file, which must not be there yet; nothing for a file that is to be
    /// made.
    ///
    /// # Errors
    /// When it is there, or cannot be written.
    pub fn keep_old(&self, beside: &Path) -> Result<(), EditError> {
        let Some(before) = &self.before else { return Ok(()) };
        if beside.exists() {
            return Err(EditError::Overtaken { path: beside.to_owned() });
        }
        put(beside, before).map_err(|cause| EditError::Unwritable { path: beside.to_owned(), cause })
    }

    /// The text as it is by now.
    pub fn text(&self) -> String {
        self.document.to_string()
    }

    /// The machine of the changed text.
    pub fn machine(&self) -> Result<Machine, EditError> {
        read(&self.path, &self.text()).map_err(EditError::Refused)
    }

    /// Put the changed text in place of the file, or make the file; returns its machine.
    ///
    /// # Errors
    /// When the text is no sound machine, when somebody changed the file meanwhile, or when it cannot be
    /// written. The file is then as it was.
    pub fn replace(self) -> Result<Machine, EditError> {
        let machine = self.machine()?;
        let now = match fs::read_to_string(&self.path) {
            Ok(text) => Some(text),
            Err(cause) if cause.kind() == ErrorKind::NotFound => None,
            Err(cause) => return Err(EditError::Unwritable { path: self.path, cause }),
        };
        if now != self.before {
            return Err(EditError::Overtaken { path: self.path });
        }
        put(&self.path, &self.text()).map_err(|cause| EditError::Unwritable { path: self.path, cause })?;
        Ok(machine)
    }

    /// The section of a path, made where it is missing; the path of what is no section as an error.
    fn section(&mut self, path: &str) -> Result<&mut dyn TableLike, String> {
        let mut table: &mut dyn TableLike = self.document.as_table_mut();
        let mut outer = String::new();
        for name in path.split('.').filter(|name| !name.is_empty()) {
            outer = if outer.is_empty() { name.to_owned() } else { format!("{outer}.{name}") };
            let item = table.entry(name).or_insert_with(|| Item::Table(made()));
            table = item.as_table_like_mut().ok_or(outer.clone())?;
        }
        Ok(table)
    }

    /// What stands around the header of a section, if it has one.
    fn header(&mut self, path: &str) -> Option<&mut Decor> {
        let mut table = self.document.as_table_mut();
        for name in path.split('.') {
            table = table.get_mut(name)?.as_table_mut()?;
        }
        Some(table.decor_mut())
    }
}

/// A section whose header is written only once there is a value in it.
fn made() -> Table {
    let mut table = Table::new();
    table.set_implicit(true);
    table
}

fn parsed(path: &Path, text: &str) -> Result<DocumentMut, EditError> {
    text.parse().map_err(|cause| EditError::Grammar { path: path.to_owned(), cause })
}

// What analysis found is of the machine, whatever the load of its bus.
fn read(path: &Path, text: &str) -> Result<Machine, Box<FileProblems>> {
    let none = Default::default();
    machine_file::read(Purpose::Files, &path.display().to_string(), text, Shelf::new(&none, path.parent()))
        .map_err(Box::new)
}

/// What stands around a value, with the comment in its column for one that takes its place.
fn aligned(old: &Value, new: &Value) -> Decor {
    let width = |value: &Value| value.clone().decorated("", "").to_string().len();
    let part = |raw: Option<&RawString>| raw.and_then(RawString::as_str).unwrap_or(" ").to_owned();
    let (before, after) = (part(old.decor().prefix()), part(old.decor().suffix()));
    let comment = after.trim_start_matches(' ');
    if comment.is_empty() {
        return old.decor().clone();
    }
    let column = after.len() - comment.len() + width(old);
    Decor::new(before, " ".repeat(column.saturating_sub(width(new)).max(1)) + comment)
}

/// Start of the further lines of a note.
const FURTHER: &str = "#   ";

/// What stands above a header, with a note in place of the one with this mark.
fn noted(before: &str, mark: &str, text: &str) -> String {
    let first = format!("# {mark}: ");
    let mut is_noted = false;
    let mut above = String::new();
    for line in before.split_inclusive('\n') {
        is_noted = line.starts_with(&first) || (is_noted && line.starts_with(FURTHER));
        if !is_noted {
            above += line;
        }
    }
    let mut start = first.as_str();
    for line in text.lines() {
        above += &format!("{start}{line}\n");
        start = FURTHER;
    }
    above
}

/// Write a draft beside the file, with its rights, and move it into its place.
fn put(path: &Path, text: &str) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let draft = folder.join(format!(".{name}.{}.part", std::process::id()));
    let written = File::create(&draft)
        .and_then(|mut out| {
            if let Ok(old) = fs::metadata(path) {
                out.set_permissions(old.permissions())?;
            }
            out.write_all(text.as_bytes())?;
            out.sync_all()
        })
        .and_then(|()| fs::rename(&draft, path))
        // The new name is on the disk only with the folder.
        .and_then(|()| File::open(folder)?.sync_all());
    written.inspect_err(|_| {
        // The cause matters more than a draft that may not even exist.
        let _ = fs::remove_file(&draft);
    })
}

#[cfg(test)]
mod tests {
    use super::super::load;
    use super::*;

    /// A folder with the reference machine in a file.
    fn reference() -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("machine.toml");
        fs::write(&path, load("reference").unwrap().text).unwrap();
        (folder, path)
    }

    /// Lines of one text that the other has not, in order.
    fn more<'a>(text: &'a str, than: &str) -> Vec<&'a str> {
        let known: Vec<&str> = than.lines().collect();
        text.lines().filter(|line| !known.contains(line)).collect()
    }

    #[test]
    fn a_value_changes_and_all_else_stays() {
        let (folder, path) = reference();
        let before = fs::read_to_string(&path).unwrap();
        let mut file = MachineFile::open(&path).unwrap();
        file.set("axis.x.friction.sliding-n", 940.25).unwrap();
        let machine = file.replace().unwrap();
        assert_eq!(machine.axes[crate::base::axis::AxisId::X].plant.friction.sliding.as_n(), 940.25);
        let after = fs::read_to_string(&path).unwrap();
        assert_eq!(more(&after, &before), ["sliding-n = 940.25                # paper, Table 1: F_low"]);
        assert_eq!(after.lines().count(), before.lines().count());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no draft is left");
    }

    #[test]
    fn a_new_section_stands_behind_its_like_with_its_note_and_the_next_note_replaces_it() {
        let (_folder, path) = reference();
        let before = fs::read_to_string(&path).unwrap();
        for (v_p, note) in [(90.0, "first\nmore of it"), (91.5, "second")] {
            let mut file = MachineFile::open(&path).unwrap();
            for axis in ["x", "y"] {
                let section = format!("axis.{axis}.gains.tuned");
                for (key, value) in [("kp-per-s", 20.0), ("v-p", v_p), ("v-i", 2.0)] {
                    file.set(&format!("{section}.{key}"), value).unwrap();
                }
                for key in ["velocity-feed-forward", "friction-feed-forward", "inertia-feed-forward"] {
                    file.set(&format!("{section}.{key}"), 0.0).unwrap();
                }
                file.note(&section, "tuned", note).unwrap();
            }
            let machine = file.replace().unwrap();
            assert_eq!(machine.gain_sets, ["standard", "optimal", "tuned"]);
        }
        let after = fs::read_to_string(&path).unwrap();
        assert!(more(&before, &after).is_empty(), "lost: {:?}", more(&before, &after));
        let added = "[axis.x.gains.optimal]\nkp-per-s = 8.55\nv-p = 99.522                      \
            # paper, Table 2\nv-i = 2.596\nvelocity-feed-forward = 0.0\nfriction-feed-forward = 0.0\n\
            inertia-feed-forward = 0.0\n\n# tuned: second\n[axis.x.gains.tuned]\nkp-per-s = 20.0\nv-p = 91.5\n";
        assert!(after.contains(added), "{after}");
        assert!(!after.contains("more of it"), "the first note is gone");
    }

    #[test]
    fn nothing_is_written_on_any_problem() {
        let (folder, path) = reference();
        let before = fs::read_to_string(&path).unwrap();
        let mut file = MachineFile::open(&path).unwrap();
        file.set("axis.x.mechanics.mass-kg", -1.0).unwrap();
        file.set("axis.x.friction.made-up", f64::NAN).unwrap();
        let Err(EditError::Refused(problems)) = file.replace() else { panic!("a wrong machine was written") };
        let keys: Vec<&str> = problems.problems.iter().map(|problem| problem.key.as_str()).collect();
        assert_eq!(keys, ["axis.x.mechanics.mass-kg", "axis.x.friction.made-up"]);

        let mut file = MachineFile::open(&path).unwrap();
        let inside = file.set("axis.x.mechanics.mass-kg.more", 1.0).unwrap_err().to_string();
        assert!(inside.contains("axis.x.mechanics.mass-kg is no section"), "{inside}");
        let away = file.note("axis.x.gains.nowhere", "tuned", "text");
        assert!(matches!(away, Err(EditError::NoSection { .. })), "{away:?}");
        assert_eq!(fs::read_to_string(&path).unwrap(), before);

        // Somebody saves the file from an editor.
        let file = MachineFile::open(&path).unwrap();
        fs::write(&path, format!("{before}# mine\n")).unwrap();
        assert!(matches!(file.replace(), Err(EditError::Overtaken { .. })));
        assert!(fs::read_to_string(&path).unwrap().ends_with("# mine\n"));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no draft is left");
    }

    #[test]
    fn a_file_is_made_from_an_embedded_machine_but_never_over_another() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new.toml");
        let paper = load("paper").unwrap();
        let made = || MachineFile::create(&path, &paper).unwrap().replace();
        assert_eq!(made().unwrap().name, "paper");
        assert_eq!(fs::read_to_string(&path).unwrap(), paper.text);
        assert!(matches!(made(), Err(EditError::Overtaken { .. })));
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link_and_the_file_keeps_its_rights() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let (folder, path) = reference();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
        let link = folder.path().join("link.toml");
        symlink(&path, &link).unwrap();
        let mut file = MachineFile::open(&link).unwrap();
        file.set("axis.x.mechanics.mass-kg", 300.0).unwrap();
        file.replace().unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert!(fs::read_to_string(&path).unwrap().contains("mass-kg = 300.0"));
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o640);
    }
}
