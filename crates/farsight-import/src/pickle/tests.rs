//! Small pickles, written by hand.

use proptest::prelude::*;

use super::{PickleError, Pickled, Value};

fn error(bytes: &[u8]) -> PickleError {
    Pickled::read(bytes).unwrap_err()
}

fn root(bytes: &[u8]) -> String {
    let pickled = Pickled::read(bytes).unwrap();
    pickled.root().describe().to_owned()
}

#[test]
fn integers_of_every_size() {
    let rows: [(&[u8], i64); 8] = [
        (b"K\xff.", 255),
        (b"M\xe9\x03.", 1001),
        (b"J\xff\xff\xff\xff.", -1),
        (b"\x8a\x00.", 0),
        (b"\x8a\x01\xff.", -1),
        (b"\x8a\x02\xff\x00.", 255),
        (b"\x8a\x08\x00\x00\x00\x00\x00\x00\x00\x80.", i64::MIN),
        (b"\x8b\x02\x00\x00\x00\x00\x80.", -32768),
    ];
    for (bytes, expected) in rows {
        let pickled = Pickled::read(bytes).unwrap();
        assert!(matches!(pickled.root(), Value::Int(number) if *number == expected), "{bytes:?} {:?}", pickled.root());
    }
    assert!(matches!(Pickled::read(b"\x8a\x09123456789.").unwrap().root(), Value::BigInt(_)));
}

#[test]
fn a_command_in_a_pickle_is_only_a_name() {
    assert_eq!(root(b"cos\nsystem\nX\x02\x00\x00\x00ls\x85R."), "os.system");
    assert_eq!(root(b"\x80\x04\x8c\x05posix\x8c\x06system\x93\x8c\x02ls\x85R}\x8c\x01aK\x01sb."), "posix.system");
}

#[test]
fn a_list_that_holds_itself_is_harmless() {
    assert_eq!(root(b"]q\x00h\x00ah\x00a."), "a list");
}

#[test]
fn the_last_of_equal_keys_counts_and_memo_entries_see_later_changes() {
    // d = {}; memo 0 = d; d["a"] = 1; d["a"] = 2; result = (d, memo 0)[1]
    let pickled = Pickled::read(b"}q\x00U\x01aK\x01sU\x01aK\x02s0h\x00.").unwrap();
    assert!(matches!(pickled.entry(pickled.root(), "a"), Some(Value::Int(2))));
}

#[test]
fn each_refusal_names_its_byte() {
    let found = |found: &str| found.to_owned();
    let rows: [(&[u8], PickleError); 12] = [
        (b"", PickleError::Truncated { at: 0 }),
        (b"X\xff\xff\xff\xffabc", PickleError::Truncated { at: 5 }),
        (b"cos\nsystem", PickleError::Truncated { at: 4 }),
        (b"NI1\n.", PickleError::Opcode { at: 1, opcode: b'I' }),
        (b".", PickleError::Stack { at: 0 }),
        (b"N(0.", PickleError::Stack { at: 2 }),
        (b"Nt.", PickleError::Stack { at: 1 }),
        (b"}(Nu.", PickleError::Stack { at: 3 }),
        (b"j\xff\xff\xff\xff.", PickleError::Memo { at: 0, index: 0xffff_ffff }),
        (b")Na.", PickleError::Type { at: 2, found: found("a tuple"), expected: "a list" }),
        (b"NNR.", PickleError::Type { at: 2, found: found("None"), expected: "a tuple" }),
        (b"K\x00Q.", PickleError::Type { at: 2, found: found("an integer"), expected: "a tuple" }),
    ];
    for (bytes, expected) in rows {
        assert_eq!(error(bytes), expected, "{bytes:?}");
    }
}

#[test]
fn a_pickle_of_millions_of_values_is_refused() {
    assert!(matches!(error(&vec![b'N'; super::MAX_VALUES + 1]), PickleError::TooMany { .. }));
}

#[test]
fn a_tensor_of_many_axes_is_refused() {
    let sizes = [&b"("[..], &b"K\x01".repeat(9), b"t"].concat();
    let storage: &[u8] = b"(U\x07storagectorch\nFloatStorage\nU\x010U\x03cpuK\x01tQ";
    let call = [b"ctorch._utils\n_rebuild_tensor_v2\n(", storage, b"K\x00", &sizes, &sizes, b"tR."].concat();
    assert!(matches!(error(&call), PickleError::Type { .. }));
}

proptest! {
    #[test]
    fn no_bytes_make_the_reader_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = Pickled::read(&bytes);
    }

    /// Opcodes alone, so that streams get far.
    #[test]
    fn no_opcodes_make_the_reader_panic(
        opcodes in prop::collection::vec(prop::sample::select(b"\x81\x85\x86\x87\x88\x8f\x90\x91\x92\x93\x94(012N)]}taesudlRbQ".to_vec()), 0..60),
    ) {
        let _ = Pickled::read(&opcodes);
    }
}
