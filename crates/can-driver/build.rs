//! Turns `protocol/ogg-joint.dbc` into the constants of the codec, so that the file is the only
//! place where the layout is written down.

use std::fmt::Write as _;
use std::{env, fs, path::Path};

#[path = "src/dbc.rs"]
#[expect(dead_code, unreachable_pub, reason = "a module of the library, of which this script needs the reading half")]
mod dbc;

fn main() {
    let source = Path::new("protocol").join("ogg-joint.dbc");
    println!("cargo::rerun-if-changed={}", source.display());
    println!("cargo::rerun-if-changed=src/dbc.rs");
    println!("cargo::rerun-if-changed=build.rs");
    let text = fs::read_to_string(&source).expect("the DBC file of the protocol is readable");
    let dbc = dbc::Dbc::parse(&text).unwrap_or_else(|e| panic!("{}: {e}", source.display()));
    let mut out = String::new();
    for message in &dbc.messages {
        let name = message.name.to_uppercase();
        writeln!(out, "pub(crate) const {name}: Message = Message {{ id: {} }};", message.id)
            .expect("writing to a String cannot fail");
        for s in &message.signals {
            writeln!(
                out,
                "pub(crate) const {name}_{}: Signal = Signal {{ start: {}, length: {}, big_endian: {}, signed: {}, factor: {:?}, offset: {:?} }};",
                s.name.to_uppercase(), s.start, s.length, s.big_endian, s.signed, s.factor, s.offset
            )
            .expect("writing to a String cannot fail");
        }
    }
    #[expect(clippy::disallowed_methods, reason = "this is how cargo tells a build script where to write")]
    let target = Path::new(&env::var_os("OUT_DIR").expect("cargo sets OUT_DIR")).join("tables.rs");
    fs::write(target, out).expect("OUT_DIR is writable");
}
