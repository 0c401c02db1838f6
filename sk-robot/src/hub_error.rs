//! Why a hub could not be started.

use crate::owner::TokenFileError;
use crate::places::PlacesError;
use sk_core::flow::database::disk::StoreError;
use sk_core::flow::{HubAddress, KeepError};
use sk_core::module::ModuleError;
use sk_core::object::NameError;
use std::io;

/// Why a hub could not be started.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HubError {
    /// No place for its files.
    #[error(transparent)]
    Places(#[from] PlacesError),
    /// No owner's token.
    #[error(transparent)]
    Token(#[from] TokenFileError),
    /// Its databases cannot be opened.
    #[error(transparent)]
    Databases(#[from] StoreError),
    /// Its accounts cannot be read, so nobody could say who would be let in.
    #[error(transparent)]
    Accounts(#[from] KeepError),
    /// The folder of its blob channels cannot be opened.
    #[error("cannot open {folder}, where the files of blob channels are: {error}")]
    Blobs {
        /// Which.
        folder: String,
        /// Why.
        error: io::Error,
    },
    /// It cannot listen.
    #[error("{address} is in use: another hub runs there; give this one another {option}")]
    Taken {
        /// Where.
        address: HubAddress,
        /// What chooses another.
        option: &'static str,
    },
    /// It cannot listen.
    #[error("cannot listen at {address}: {error}")]
    Listen {
        /// Where.
        address: HubAddress,
        /// What the system said.
        #[source]
        error: io::Error,
    },
    /// What is shown to those who come by TLS cannot be.
    #[error("`listen.{key}`: {path}: {why}")]
    Tls {
        /// The key of the configuration.
        key: &'static str,
        /// The file.
        path: String,
        /// What is wrong.
        why: String,
    },
    /// An address with TLS, and nothing to show there.
    #[error(
        "{0} needs a certificate: say --tls CERTIFICATE KEY (`listen.tls_certificate`, `listen.tls_key`)"
    )]
    NoCertificate(HubAddress),
    /// The account's name cannot be.
    #[error("the account {0:?} cannot be: {1}")]
    Account(String, #[source] sk_flat::NameError),
    /// A module's name cannot be or is given twice.
    #[error("module {0}: {1}")]
    Module(&'static str, #[source] NameError),
    /// A module's parameters cannot be.
    #[error("module {0}: {1}")]
    Parameters(&'static str, #[source] ModuleError),
    /// A link inside the process could not be made.
    #[error("a module cannot be linked to the hub: {0}")]
    Link(#[source] io::Error),
}
