//! Reads a Rust file: the docs of its items, its comments, and its texts for people.

use proc_macro2::{LineColumn, TokenStream, TokenTree};
use syn::visit::{self, Visit};
use syn::{Attribute, Expr, Ident, Lit, LitStr, Meta, Visibility};

use super::text::{Kind, Text};
use crate::Result;
use crate::sources::{attributes, is_for_tests};

/// Returns the texts of a file, in which what is for tests alone is left out.
pub(super) fn read(source: &str) -> Result<Vec<Text>> {
    // The spans of files read before would be kept for as long as the thread runs.
    proc_macro2::extra::invalidate_current_thread_spans();
    let tokens: TokenStream = source.parse().map_err(|error| format!("{error}"))?;
    let file: syn::File = syn::parse2(tokens.clone())?;
    let mut reader = Reader::default();
    reader.visit_file(&file);
    let mut comments = Comments::new(source);
    comments.read(tokens);
    comments.gap(source.len());
    let comments = comments.found.into_iter().filter(|comment| {
        let lines = &reader.for_tests;
        !lines
            .iter()
            .any(|(first, last)| (*first..=*last).contains(&comment.line))
    });
    reader.texts.extend(comments);
    Ok(reader.texts)
}

/// Collects docs and texts for people.
#[derive(Default)]
struct Reader {
    texts: Vec<Text>,
    /// The first and last lines of modules that only tests have.
    for_tests: Vec<(usize, usize)>,
    /// True if the docs of the item that is being read are the help of a command.
    help: bool,
    /// True if the implementation that is being read is one of `Display`.
    display: bool,
    /// True if members of the item that is being read are public without `pub`.
    public: bool,
}

impl Reader {
    fn doc(&mut self, attributes: &[Attribute], kind: Kind, name: &str, public: bool) {
        let lines = attributes.iter().filter_map(|attribute| {
            let Meta::NameValue(value) = &attribute.meta else {
                return None;
            };
            if !value.path.is_ident("doc") {
                return None;
            }
            let text = literal(&value.value)?;
            Some((text.span().start().line, text.value()))
        });
        let lines: Vec<_> = lines.collect();
        if let Some((line, _)) = lines.first() {
            let text = lines
                .iter()
                .map(|(_, text)| text.strip_prefix(' ').unwrap_or(text));
            let text: Vec<_> = text.collect();
            self.texts.push(Text {
                line: *line,
                kind: if self.help { Kind::Help } else { kind },
                public,
                name: name.to_owned(),
                body: text.join("\n"),
            });
        }
        for attribute in attributes {
            self.attribute(attribute, name);
        }
    }

    /// Finds the texts of `#[error("…")]`, `#[arg(help = "…")]` and their like.
    fn attribute(&mut self, attribute: &Attribute, name: &str) {
        let Meta::List(list) = &attribute.meta else {
            return;
        };
        if list.path.is_ident("error") {
            if let Some(TokenTree::Literal(first)) = list.tokens.clone().into_iter().next() {
                self.message(Kind::Message, &Lit::new(first), name);
            }
        } else if is_clap(attribute) {
            let mut before = [String::new(), String::new()];
            for token in list.tokens.clone() {
                if let TokenTree::Literal(it) = &token {
                    let [key, equals] = &before;
                    let texts = ["help", "long_help", "about", "long_about", "after_help"];
                    if equals == "=" && texts.contains(&key.as_str()) {
                        self.message(Kind::Help, &Lit::new(it.clone()), name);
                    }
                }
                before = [std::mem::take(&mut before[1]), token.to_string()];
            }
        }
    }

    fn message(&mut self, kind: Kind, literal: &Lit, name: &str) {
        if let Lit::Str(text) = literal {
            self.texts.push(Text {
                line: text.span().start().line,
                kind,
                public: true,
                name: name.to_owned(),
                body: text.value(),
            });
        }
    }

    /// Reads an item whose members are public or not.
    fn inside(&mut self, public: bool, help: bool, read: impl FnOnce(&mut Self)) {
        let outer = (self.public, self.help);
        (self.public, self.help) = (public, help);
        read(self);
        (self.public, self.help) = outer;
    }

    fn item(
        &mut self,
        attributes: &[Attribute],
        kind: Kind,
        name: &Ident,
        visibility: &Visibility,
    ) {
        self.doc(attributes, kind, &name.to_string(), is_public(visibility));
    }

    fn value(&mut self, attributes: &[Attribute], name: Option<&Ident>, public: bool) {
        let name = name.map(ToString::to_string).unwrap_or_default();
        self.doc(attributes, Kind::Value, &name, public);
    }
}

impl<'ast> Visit<'ast> for Reader {
    fn visit_file(&mut self, file: &'ast syn::File) {
        self.doc(&file.attrs, Kind::Module, "", true);
        visit::visit_file(self, file);
    }

    fn visit_item(&mut self, item: &'ast syn::Item) {
        if is_for_tests(attributes(item)) {
            if let syn::Item::Mod(module) = item
                && let Some((braces, _)) = &module.content
            {
                let (open, close) = (braces.span.open(), braces.span.close());
                let lines = (open.start().line, close.end().line);
                self.for_tests.push(lines);
            }
        } else {
            visit::visit_item(self, item);
        }
    }

    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        self.item(&item.attrs, Kind::Module, &item.ident, &item.vis);
        visit::visit_item_mod(self, item);
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        self.item(&item.attrs, Kind::Function, &item.sig.ident, &item.vis);
        self.inside(false, false, |reader| visit::visit_item_fn(reader, item));
    }

    fn visit_item_struct(&mut self, item: &'ast syn::ItemStruct) {
        let (name, public) = (item.ident.to_string(), is_public(&item.vis));
        self.inside(public, has_help(&item.attrs), |reader| {
            reader.doc(&item.attrs, Kind::Type, &name, public);
            for field in &item.fields {
                let public = public && is_public(&field.vis);
                reader.value(&field.attrs, field.ident.as_ref(), public);
            }
        });
    }

    fn visit_item_enum(&mut self, item: &'ast syn::ItemEnum) {
        let (name, public) = (item.ident.to_string(), is_public(&item.vis));
        self.inside(public, has_help(&item.attrs), |reader| {
            reader.doc(&item.attrs, Kind::Type, &name, public);
            for variant in &item.variants {
                reader.value(&variant.attrs, Some(&variant.ident), public);
                for field in &variant.fields {
                    reader.value(&field.attrs, field.ident.as_ref(), public);
                }
            }
        });
    }

    fn visit_item_union(&mut self, item: &'ast syn::ItemUnion) {
        self.item(&item.attrs, Kind::Type, &item.ident, &item.vis);
    }

    fn visit_item_type(&mut self, item: &'ast syn::ItemType) {
        self.item(&item.attrs, Kind::Type, &item.ident, &item.vis);
    }

    fn visit_item_const(&mut self, item: &'ast syn::ItemConst) {
        self.item(&item.attrs, Kind::Value, &item.ident, &item.vis);
        visit::visit_item_const(self, item);
    }

    fn visit_item_static(&mut self, item: &'ast syn::ItemStatic) {
        self.item(&item.attrs, Kind::Value, &item.ident, &item.vis);
        visit::visit_item_static(self, item);
    }

    fn visit_item_macro(&mut self, item: &'ast syn::ItemMacro) {
        let exported = |it: &Attribute| it.path().is_ident("macro_export");
        if let Some(name) = &item.ident {
            let public = item.attrs.iter().any(exported);
            self.doc(&item.attrs, Kind::Type, &name.to_string(), public);
        }
        visit::visit_item_macro(self, item);
    }

    fn visit_item_trait(&mut self, item: &'ast syn::ItemTrait) {
        let (name, public) = (item.ident.to_string(), is_public(&item.vis));
        self.doc(&item.attrs, Kind::Type, &name, public);
        self.inside(public, false, |reader| {
            visit::visit_item_trait(reader, item);
        });
    }

    fn visit_trait_item_fn(&mut self, item: &'ast syn::TraitItemFn) {
        let name = item.sig.ident.to_string();
        self.doc(&item.attrs, Kind::Function, &name, self.public);
        self.inside(false, false, |reader| {
            visit::visit_trait_item_fn(reader, item);
        });
    }

    fn visit_trait_item_const(&mut self, item: &'ast syn::TraitItemConst) {
        self.value(&item.attrs, Some(&item.ident), self.public);
    }

    fn visit_trait_item_type(&mut self, item: &'ast syn::TraitItemType) {
        let name = item.ident.to_string();
        self.doc(&item.attrs, Kind::Type, &name, self.public);
    }

    fn visit_item_impl(&mut self, item: &'ast syn::ItemImpl) {
        let of = item.trait_.as_ref().and_then(|it| it.1.segments.last());
        let display = of.is_some_and(|it| it.ident == "Display");
        let outer = std::mem::replace(&mut self.display, display);
        self.inside(false, false, |reader| visit::visit_item_impl(reader, item));
        self.display = outer;
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        if is_for_tests(&item.attrs) {
            return;
        }
        self.item(&item.attrs, Kind::Function, &item.sig.ident, &item.vis);
        visit::visit_impl_item_fn(self, item);
    }

    fn visit_impl_item_const(&mut self, item: &'ast syn::ImplItemConst) {
        self.item(&item.attrs, Kind::Value, &item.ident, &item.vis);
    }

    fn visit_macro(&mut self, call: &'ast syn::Macro) {
        let Some(name) = call.path.segments.last().map(|it| it.ident.to_string()) else {
            return;
        };
        let mut tokens = call.tokens.clone().into_iter();
        match name.as_str() {
            "print" | "println" | "eprint" | "eprintln" => {}
            "write" | "writeln" if self.display => {
                // The text follows the place that it is written to.
                tokens.find(|token| matches!(token, TokenTree::Punct(it) if it.as_char() == ','));
            }
            _ => return,
        }
        if let Some(TokenTree::Literal(text)) = tokens.next() {
            self.message(Kind::Message, &Lit::new(text), &name);
        }
    }
}

fn literal(value: &Expr) -> Option<&LitStr> {
    match value {
        Expr::Lit(syn::ExprLit {
            lit: Lit::Str(text),
            ..
        }) => Some(text),
        _ => None,
    }
}

fn is_public(visibility: &Visibility) -> bool {
    matches!(visibility, Visibility::Public(_))
}

fn is_clap(attribute: &Attribute) -> bool {
    let path = attribute.path();
    ["arg", "command", "clap", "value"]
        .iter()
        .any(|name| path.is_ident(name))
}

/// Returns true if clap prints the docs of the item and of its fields.
fn has_help(attributes: &[Attribute]) -> bool {
    let derives = ["Parser", "Args", "Subcommand", "ValueEnum"];
    attributes.iter().any(|attribute| match &attribute.meta {
        Meta::List(list) if list.path.is_ident("derive") => {
            let mut tokens = list.tokens.clone().into_iter();
            tokens.any(|token| derives.contains(&token.to_string().as_str()))
        }
        _ => false,
    })
}

/// Collects the comments of a file: they lie in the gaps between its tokens, and docs are tokens.
struct Comments<'s> {
    source: &'s str,
    /// The offset at which each line begins.
    lines: Vec<usize>,
    /// The end of the token read last.
    end: usize,
    found: Vec<Text>,
    /// The line of the comment read last, if nothing but a comment stands on it.
    last: Option<usize>,
}

impl<'s> Comments<'s> {
    fn new(source: &'s str) -> Self {
        let breaks = source.match_indices('\n').map(|(at, _)| at + 1);
        Self {
            source,
            lines: std::iter::once(0).chain(breaks).collect(),
            end: 0,
            found: Vec::new(),
            last: None,
        }
    }

    fn read(&mut self, tokens: TokenStream) {
        for token in tokens {
            if let TokenTree::Group(group) = token {
                self.token(group.span_open());
                self.read(group.stream());
                self.token(group.span_close());
            } else {
                self.token(token.span());
            }
        }
    }

    fn token(&mut self, span: proc_macro2::Span) {
        let (start, end) = (self.offset(span.start()), self.offset(span.end()));
        self.gap(start);
        self.end = self.end.max(end);
    }

    /// Returns the offset of a place whose column is counted in characters.
    fn offset(&self, place: LineColumn) -> usize {
        let line = self.lines.get(place.line - 1).copied();
        let line = line.unwrap_or(self.source.len());
        let rest = &self.source[line..];
        // Most lines are ASCII up to there, which is quicker to see than to count.
        if rest
            .as_bytes()
            .get(..place.column)
            .is_some_and(<[u8]>::is_ascii)
        {
            return line + place.column;
        }
        let mut characters = rest.char_indices();
        line + characters
            .nth(place.column)
            .map_or(rest.len(), |(offset, _)| offset)
    }

    /// Reads the comments between the token read last and the offset `to`.
    fn gap(&mut self, to: usize) {
        if to <= self.end {
            return;
        }
        let source = self.source;
        let mut at = self.end;
        for piece in source[self.end..to].split_inclusive('\n') {
            let text = piece.trim();
            if let Some(text) = text.strip_prefix("//") {
                let line = self.lines.partition_point(|start| *start <= at);
                let alone = source[self.lines[line - 1]..at].trim().is_empty();
                let text = text.strip_prefix(' ').unwrap_or(text);
                self.line(line, alone, text);
            }
            at += piece.len();
        }
    }

    fn line(&mut self, line: usize, alone: bool, text: &str) {
        let follows = alone && self.last.is_some_and(|last| last + 1 == line);
        self.last = alone.then_some(line);
        match self.found.last_mut() {
            Some(comment) if follows => {
                comment.body.push('\n');
                comment.body.push_str(text);
            }
            _ => self.found.push(Text {
                line,
                kind: Kind::Comment,
                public: false,
                name: String::new(),
                body: text.to_owned(),
            }),
        }
    }
}
