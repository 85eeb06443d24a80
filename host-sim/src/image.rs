//! How much memory the firmware image takes.

use std::fs;
use std::path::Path;

use anyhow::Context;
use object::elf::{SHF_ALLOC, SHF_EXECINSTR, SHF_WRITE, SHT_NOBITS};
use object::{File, Object, ObjectSection, ObjectSymbol, SectionFlags, SectionKind};

/// Sizes of an image's parts in bytes, counted as the program `size` does.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sizes {
    /// Code and constants, interrupt vectors too.
    pub text: u64,
    /// Variables with an initial value: in flash, and copied to RAM at the start.
    pub data: u64,
    /// Variables that start at zero, or with what the RAM holds (`.uninit`).
    pub bss: u64,
    /// Room for the stack, from `memory.x`. `size` does not count it.
    pub stack: u64,
    /// The static that holds the logger, part of `bss`; 0 if the image has none.
    pub logger: u64,
}

impl Sizes {
    /// Sizes of the image at `path`.
    ///
    /// # Errors
    /// The file is missing or no ELF file.
    pub fn of(path: &Path) -> anyhow::Result<Self> {
        let bytes = fs::read(path).with_context(|| {
            format!(
                "the image {} cannot be read; `sh tests/build-firmware.sh` builds it",
                path.display()
            )
        })?;
        Self::in_elf(&bytes).with_context(|| format!("{} is no ELF image", path.display()))
    }

    /// Sizes of the image whose ELF file is `bytes`.
    ///
    /// # Errors
    /// It is no ELF file.
    pub fn in_elf(bytes: &[u8]) -> anyhow::Result<Self> {
        let elf = File::parse(bytes)?;
        let mut sizes = Self::default();
        for section in elf.sections() {
            let SectionFlags::Elf { sh_flags } = section.flags() else {
                continue;
            };
            let is = |flag: u32| sh_flags & u64::from(flag) != 0;
            if !is(SHF_ALLOC) {
                continue;
            }
            let no_bits = matches!(
                section.kind(),
                SectionKind::UninitializedData | SectionKind::Elf(SHT_NOBITS)
            );
            let part = if no_bits {
                &mut sizes.bss
            } else if is(SHF_EXECINSTR) || !is(SHF_WRITE) {
                &mut sizes.text
            } else {
                &mut sizes.data
            };
            *part += section.size();
        }
        let address = |name| elf.symbol_by_name(name).map(|symbol| symbol.address());
        if let (Some(top), Some(bottom)) = (address("_stack_start"), address("_stack_end")) {
            sizes.stack = top.saturating_sub(bottom);
        }
        let is_logger = |name: &str| name.contains("LOGGER");
        let logger = elf.symbols().find(|symbol| symbol.name().is_ok_and(is_logger));
        sizes.logger = logger.map_or(0, |symbol| symbol.size());
        Ok(sizes)
    }

    /// Flash that the image takes, bytes.
    pub fn flash(&self) -> u64 {
        self.text + self.data
    }

    /// RAM that its variables take, bytes; without the stack.
    pub fn ram(&self) -> u64 {
        self.data + self.bss
    }
}
