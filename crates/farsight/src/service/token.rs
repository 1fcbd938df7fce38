//! The word that requests must bring.

use std::fmt;
use std::hint::black_box;

use thiserror::Error;

/// Shorter ones are guessed.
const MIN_LENGTH: usize = 16;

/// A word that requests must bring.
#[derive(Clone)]
pub struct Token(Box<[u8]>);

/// A token that is none.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("the token is no such word; expected at least {MIN_LENGTH} letters, digits and signs of ASCII, no spaces")]
pub struct TokenError;

impl Token {
    /// The token `text`; spaces and line breaks around it are no part of it.
    ///
    /// # Errors
    /// When it is too short or could not stand in a header.
    pub fn new(text: &str) -> Result<Self, TokenError> {
        let text = text.trim();
        if text.len() < MIN_LENGTH || !text.bytes().all(|byte| byte.is_ascii_graphic()) {
            return Err(TokenError);
        }
        Ok(Self(text.as_bytes().into()))
    }

    /// Whether `given` is this token. How long that takes tells the length of `given` and nothing of the token.
    pub fn is(&self, given: &[u8]) -> bool {
        let own = given.iter().zip(self.0.iter().cycle());
        let difference = own.fold(0, |difference, (given, own)| black_box(difference | (given ^ own)));
        difference == 0 && given.len() == self.0.len()
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

#[cfg(test)]
mod tests {
    use super::{Token, TokenError};

    #[test]
    fn only_the_very_word_is_the_token() {
        let token = Token::new(" 0123456789abcdef\n").unwrap();
        assert!(token.is(b"0123456789abcdef"));
        for other in ["", "0123456789abcde", "0123456789abcdeF", "0123456789abcdef0123456789abcdef", "1123456789abcdef"]
        {
            assert!(!token.is(other.as_bytes()), "{other}");
        }
        assert!(!format!("{token:?}").contains('0'));
    }

    #[test]
    fn words_that_are_guessed_or_fit_in_no_header_are_none() {
        for text in ["", "0123456789abcde", "0123456789 abcdef", "0123456789äbcdef0"] {
            assert_eq!(Token::new(text).unwrap_err(), TokenError, "{text}");
        }
    }
}
