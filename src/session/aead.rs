//! ChaCha20-Poly1305 (RFC 8439, section 2.8), joined from its two parts.
//!
//! ```text
//! one-time key, keystream = ChaCha20(key, nonce): bytes 0 to 31, and from byte 64 on
//! tag = Poly1305(one-time key; associated data, padded | ciphertext, padded | both lengths u64)
//! ```
//!
//! The crate `chacha20poly1305` joins the same parts, but panics where a keystream would end (after 256 GiB), and the image must hold no
//! panic. A test below compares with it.

use chacha20::cipher::StreamCipher;
use chacha20::{ChaCha20, KeyIvInit};
use poly1305::Poly1305;
use poly1305::universal_hash::{KeyInit, UniversalHash};

use super::seal::KEY_BYTES;

/// Bytes of a tag.
pub(super) const TAG_BYTES: usize = 16;
/// Bytes of a nonce.
pub(super) const NONCE_BYTES: usize = 12;
/// Bytes of a block of the keystream; the first is for the one-time key alone.
const BLOCK_BYTES: usize = 64;

/// Encrypts `bytes` in their place; the tag. None if they are longer than a keystream.
pub(super) fn seal(
    key: &[u8; KEY_BYTES],
    nonce: &[u8; NONCE_BYTES],
    associated: &[u8],
    bytes: &mut [u8],
) -> Option<[u8; TAG_BYTES]> {
    let (mut keystream, poly) = begin(key, nonce)?;
    keystream.try_apply_keystream(bytes).ok()?;
    Some(absorb(poly, associated, bytes).finalize().into())
}

/// Decrypts `bytes` in their place if `tag` is theirs, compared in constant time; says whether it is.
#[must_use]
pub(super) fn open(
    key: &[u8; KEY_BYTES],
    nonce: &[u8; NONCE_BYTES],
    associated: &[u8],
    bytes: &mut [u8],
    tag: &[u8; TAG_BYTES],
) -> bool {
    let Some((mut keystream, poly)) = begin(key, nonce) else {
        return false;
    };
    let genuine = absorb(poly, associated, bytes).verify(&(*tag).into()).is_ok();
    genuine && keystream.try_apply_keystream(bytes).is_ok()
}

/// The keystream behind its first block, and the authenticator that this block gives.
fn begin(key: &[u8; KEY_BYTES], nonce: &[u8; NONCE_BYTES]) -> Option<(ChaCha20, Poly1305)> {
    let mut keystream = ChaCha20::new(key.into(), nonce.into());
    let mut block = [0; BLOCK_BYTES];
    keystream.try_apply_keystream(&mut block).ok()?;
    let one_time_key: &[u8; poly1305::KEY_SIZE] = block.first_chunk()?;
    Some((keystream, Poly1305::new(one_time_key.into())))
}

/// All that a tag covers.
fn absorb(mut poly: Poly1305, associated: &[u8], ciphertext: &[u8]) -> Poly1305 {
    poly.update_padded(associated);
    poly.update_padded(ciphertext);
    let [associated, ciphertext] = [associated, ciphertext].map(|bytes| bytes.len() as u64);
    let lengths = u128::from(associated) | u128::from(ciphertext) << 64;
    poly.update(&[lengths.to_le_bytes().into()]);
    poly
}

#[cfg(test)]
mod tests {
    use chacha20poly1305::ChaCha20Poly1305;
    use chacha20poly1305::aead::AeadInOut;
    use chacha20poly1305::aead::inout::InOutBuf;

    use super::*;

    /// RFC 8439, section 2.8.2.
    #[test]
    fn the_rfc_s_example_is_sealed_as_it_says() {
        let key = core::array::from_fn(|i| 0x80 + i as u8);
        let nonce = [7, 0, 0, 0, 0x40, 0x41, 0x42, 0x43, 0x44, 0x45, 0x46, 0x47];
        let associated = [0x50, 0x51, 0x52, 0x53, 0xc0, 0xc1, 0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7];
        let text = b"Ladies and Gentlemen of the class of '99: If I could offer you only one tip for the future, sunscreen would be it.";
        let mut bytes = *text;
        let tag = seal(&key, &nonce, &associated, &mut bytes).expect("a short text");
        assert_eq!(bytes[..8], [0xd3, 0x1a, 0x8d, 0x34, 0x64, 0x8e, 0x60, 0xdb]);
        assert_eq!(u128::from_be_bytes(tag), 0x1ae1_0b59_4f09_e26a_7e90_2ecb_d060_0691);
        assert!(open(&key, &nonce, &associated, &mut bytes, &tag));
        assert_eq!(&bytes, text);
    }

    #[test]
    fn any_length_is_sealed_and_opened_as_by_the_crate_that_joins_the_parts() {
        let byte = |seed: usize, i: usize| (seed * 151 + i * 37 + i * i / 8) as u8;
        for length in 0..700 {
            let key: [u8; KEY_BYTES] = core::array::from_fn(|i| byte(length, i));
            let nonce: [u8; NONCE_BYTES] = core::array::from_fn(|i| byte(length + 1, i));
            let associated: [u8; 40] = core::array::from_fn(|i| byte(length + 2, i));
            let associated = &associated[..length % 41];
            let text: [u8; 700] = core::array::from_fn(|i| byte(length + 3, i));
            let text = &text[..length];

            let (mut ours, mut theirs) = ([0; 700], [0; 700]);
            let (ours, theirs) = (&mut ours[..length], &mut theirs[..length]);
            ours.copy_from_slice(text);
            theirs.copy_from_slice(text);
            let tag = seal(&key, &nonce, associated, ours).expect("a short text");
            let other = ChaCha20Poly1305::new(&key.into())
                .encrypt_inout_detached(&nonce.into(), associated, InOutBuf::from(&mut *theirs))
                .expect("a short text");
            assert_eq!((&*ours, &tag[..]), (&*theirs, &other[..]), "{length} bytes");

            let mut wrong = tag;
            wrong[length % TAG_BYTES] ^= 1 << (length % 8);
            assert!(!open(&key, &nonce, associated, ours, &wrong), "{length} bytes");
            assert_eq!(ours, theirs, "a refused text stays as it is");
            assert!(open(&key, &nonce, associated, ours, &tag), "{length} bytes");
            assert_eq!(ours, text);
        }
    }
}
